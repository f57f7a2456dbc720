"""Transmissions: lengths of actuators, and the joint forces that a force along them makes.

Most actuators drive one hinge or slide. Those keep only their gear; the others have a dense row
of the moment matrix.
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.dynamics.jacobian import site_jacobian
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tendon import tendon_jacobian, tendon_length
from jaxsim.joints.types import BALL, FREE
from jaxsim.model import Model
from jaxsim.spatial import (
    quat_difference,
    quat_inv_rotate,
    quat_log,
    quat_mul,
    quat_normalize,
)

JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
JOINTINPARENT = int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
SITE = int(mujoco.mjtTrn.mjTRN_SITE)


@struct.dataclass
class Transmission:
    """Lengths of the actuators and their derivatives.

    Attributes:
      length: of each actuator; zero where no length makes sense (free joints, lone sites).
      gear: gears of the actuators in `scalar_actuators`.
      rows: derivatives of the lengths of the others, as rows over the degrees of freedom.
    """

    length: Float[Array, "nu"]
    gear: Float[Array, "nscalar"]
    rows: Float[Array, "nother nv"]


def transmission(model: Model, kin: Kinematics, qpos: Float[Array, "nq"]) -> Transmission:
    """Lengths and moments of all actuators.

    Args:
      model: the model.
      kin: its kinematics.
      qpos: coordinates.
    """
    scalar, other = scalar_actuators(model)
    gear = take(model.actuator_gear[:, 0], scalar)
    lengths = [gear * take(qpos, model.jnt_qposadr[model.actuator_trnid[scalar, 0]])]
    rows = [jnp.zeros((0, model.nv), gear.dtype)]
    for i in other:
        length, row = _one(model, kin, qpos, int(i))
        lengths.append(length[None])
        rows.append(row[None])
    order = np.argsort(np.concatenate([scalar, other]))
    return Transmission(
        length=take(jnp.concatenate(lengths), order), gear=gear, rows=jnp.concatenate(rows)
    )


def actuator_velocity(
    model: Model, t: Transmission, qvel: Float[Array, "nv"]
) -> Float[Array, "nu"]:
    """Rates of the lengths."""
    scalar, other = scalar_actuators(model)
    parts = [t.gear * take(qvel, _scalar_dofs(model)), t.rows @ qvel]
    return take(jnp.concatenate(parts), np.argsort(np.concatenate([scalar, other])))


def force_on_joints(model: Model, t: Transmission, force: Float[Array, "nu"]) -> Float[Array, "nv"]:
    """Generalised forces `moment^T force`."""
    scalar, other = scalar_actuators(model)
    qfrc = sum_by(t.gear * take(force, scalar), _scalar_dofs(model), model.nv)
    return qfrc + take(force, other) @ t.rows if len(other) else qfrc


def actuator_moment(model: Model, t: Transmission) -> Float[Array, "nu nv"]:
    """All rows of the moment matrix: derivatives of the lengths."""
    scalar, other = scalar_actuators(model)
    dense = jnp.zeros((len(scalar), model.nv), t.gear.dtype)
    dense = dense.at[np.arange(len(scalar)), _scalar_dofs(model)].set(t.gear)
    return take(jnp.concatenate([dense, t.rows]), np.argsort(np.concatenate([scalar, other])))


def scalar_actuators(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Actuators of a single hinge or slide, and all others; static."""
    on_joint = np.isin(model.actuator_trntype, (JOINT, JOINTINPARENT))
    joint = np.where(on_joint, model.actuator_trnid[:, 0], 0)
    kind = model.jnt_type[joint] if model.njnt else np.zeros(model.nu, int)
    scalar = on_joint & (kind != FREE) & (kind != BALL)
    return np.nonzero(scalar)[0], np.nonzero(~scalar)[0]


def scalar_damping(model: Model, t: Transmission, slope: Float[Array, "nu"]) -> Float[Array, "nv"]:
    """Diagonal of `moment^T diag(slope) moment` from the scalar actuators alone."""
    scalar, _ = scalar_actuators(model)
    return sum_by(t.gear * t.gear * take(slope, scalar), _scalar_dofs(model), model.nv)


def _scalar_dofs(model: Model) -> np.ndarray:
    scalar, _ = scalar_actuators(model)
    return model.jnt_dofadr[model.actuator_trnid[scalar, 0]]


def _one(model: Model, kin: Kinematics, qpos, i: int):
    """Length and row of one actuator that is not on a hinge or slide."""
    kind, gear = int(model.actuator_trntype[i]), model.actuator_gear[i]
    target, reference = (int(k) for k in model.actuator_trnid[i])
    if kind == TENDON:
        length, row = tendon_length(model, qpos)[target], tendon_jacobian(model)[target]
        return gear[0] * length, gear[0] * row
    if kind == SITE and reference < 0:
        return jnp.zeros_like(gear[0]), _site_row(model, kin, gear, target, kin.site_xmat[target])
    if kind == SITE:
        return _site_pair(model, kin, gear, target, reference)
    return _rotating_joint(model, qpos, gear, target, in_parent=kind == JOINTINPARENT)


def _rotating_joint(model: Model, qpos, gear, joint: int, in_parent: bool):
    """Ball: a torque about `gear[:3]`. Free: a force `gear[:3]` and a torque about `gear[3:]`."""
    free = model.jnt_type[joint] == FREE
    start, dof = model.jnt_qposadr[joint] + (3 if free else 0), model.jnt_dofadr[joint]
    quat = quat_normalize(qpos[start : start + 4])
    axis = gear[3:] if free else gear[:3]
    if in_parent:
        axis = quat_inv_rotate(quat, axis)
    length = jnp.zeros_like(gear[0]) if free else quat_log(quat) @ axis
    moment = jnp.concatenate([gear[:3], axis]) if free else axis
    return length, jnp.pad(moment, (dof, model.nv - dof - len(moment)))


def _site_pair(model: Model, kin: Kinematics, gear, site: int, reference: int):
    """Displacement and rotation of a site in the axes of another, weighted by the gear."""
    mat, moved = kin.site_xmat[reference], kin.site_xpos[site] - kin.site_xpos[reference]
    turned = quat_difference(_site_quat(model, kin, reference), _site_quat(model, kin, site))
    length = (moved @ mat) @ gear[:3] + turned @ gear[3:]
    rows = [_site_row(model, kin, gear, s, mat) for s in (site, reference)]
    # What moves both sites together leaves the length as it is.
    links = model.body_link[model.site_bodyid[[site, reference]]]
    both = (model.tree.moves[links[0]] & model.tree.moves[links[1]])[model.structure.dof_position]
    return length, jnp.where(both, 0, rows[0] - rows[1])


def _site_row(model: Model, kin: Kinematics, gear, site: int, mat):
    """(nv,) what a force `gear[:3]` and a torque `gear[3:]`, in the axes of `mat`, do at a site."""
    jacp, jacr = site_jacobian(model, kin, site)
    return (mat @ gear[:3]) @ jacp + (mat @ gear[3:]) @ jacr


def _site_quat(model: Model, kin: Kinematics, site: int):
    return quat_mul(kin.xquat[model.site_bodyid[site]], quat_normalize(model.site_quat[site]))
