"""Transmissions: lengths of actuators and their moments, the derivatives of the lengths.

An actuator has one length, one velocity and one force, or three if it turns a body to an
orientation (transmission SO3); the axis of all of them is `nout`. Most actuators drive a joint with
one degree of freedom. For these the gear is stored, for the others a dense row of the moment
matrix.
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.dynamics.jacobian import site_jacobian
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tendons.tendon import tendon_jacobian
from jaxsim.joints import JOINTS
from jaxsim.joints.grouping import per_joint, position_rows
from jaxsim.model import Model
from jaxsim.spatial import quat_difference, quat_log, quat_mul, quat_normalize

JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
JOINTINPARENT = int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
SLIDERCRANK = int(mujoco.mjtTrn.mjTRN_SLIDERCRANK)
SITE = int(mujoco.mjtTrn.mjTRN_SITE)
BODY = int(mujoco.mjtTrn.mjTRN_BODY)
SO3 = int(mujoco.mjtTrn.mjTRN_SO3)


@struct.dataclass
class Transmission:
    """Lengths of the actuators and their derivatives.

    Attributes:
      length: length of each actuator; zero where none is defined (free joints, sites without a
        reference site).
      gear: gears of the actuators of scalar joints, see `scalar_outputs`.
      rows: moments of the other actuators, rows over the degrees of freedom.
    """

    length: Float[Array, "nout"]
    gear: Float[Array, "nscalar"]
    rows: Float[Array, "nother nv"]


def transmission(model: Model, kin: Kinematics, qpos: Float[Array, "nq"]) -> Transmission:
    """Lengths and moments of all actuators.

    Args:
      model: the model.
      kin: its kinematics.
      qpos: coordinates.
    """
    scalar, other = scalar_outputs(model)
    on_tendon = model.actuator_trntype[model.structure.out_actuator[other]] == TENDON
    ids = np.concatenate([other[on_tendon], other[~on_tendon]])
    length, gear = _scalar(model, qpos, scalar)
    of_tendons = _tendons(model, kin, other[on_tendon])
    lengths, rows = [length, of_tendons[0]], [of_tendons[1]]
    for i in np.unique(model.structure.out_actuator[other[~on_tendon]]):
        length, row = _one(model, kin, qpos, int(i))
        lengths.append(length.reshape(-1))
        rows.append(row.reshape(-1, model.nv))
    return Transmission(
        length=take(jnp.concatenate(lengths), np.argsort(np.concatenate([scalar, ids]))),
        gear=gear,
        rows=take(jnp.concatenate(rows), np.argsort(ids)),
    )


def actuator_velocity(
    model: Model, t: Transmission, qvel: Float[Array, "nv"]
) -> Float[Array, "nout"]:
    """Rates of the lengths."""
    scalar, other = scalar_outputs(model)
    parts = [t.gear * take(qvel, _scalar_dofs(model)), t.rows @ qvel]
    return take(jnp.concatenate(parts), np.argsort(np.concatenate([scalar, other])))


def force_on_joints(
    model: Model, t: Transmission, force: Float[Array, "nout"]
) -> Float[Array, "nv"]:
    """Generalised forces `moment^T force`."""
    scalar, other = scalar_outputs(model)
    qfrc = sum_by(t.gear * take(force, scalar), _scalar_dofs(model), model.nv)
    return qfrc + take(force, other) @ t.rows if len(other) else qfrc


def actuator_moment(model: Model, t: Transmission) -> Float[Array, "nout nv"]:
    """All rows of the moment matrix: derivatives of the lengths."""
    scalar, other = scalar_outputs(model)
    dense = jnp.zeros((len(scalar), model.nv), t.gear.dtype)
    dense = dense.at[np.arange(len(scalar)), _scalar_dofs(model)].set(t.gear)
    return take(jnp.concatenate([dense, t.rows]), np.argsort(np.concatenate([scalar, other])))


def scalar_outputs(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Forces of the actuators of joints with one degree of freedom, and all others; static."""
    scalar = np.isin(model.actuator_trntype, (JOINT, JOINTINPARENT))
    ndof = np.bincount(model.dof_jntid, minlength=model.njnt)
    scalar[scalar] = ndof[model.actuator_trnid[scalar, 0]] == 1
    scalar = scalar[model.structure.out_actuator]
    return np.nonzero(scalar)[0], np.nonzero(~scalar)[0]


def scalar_damping(
    model: Model, t: Transmission, slope: Float[Array, "nout"]
) -> Float[Array, "nv"]:
    """Diagonal of `moment^T diag(slope) moment` from the actuators of scalar joints alone."""
    scalar, _ = scalar_outputs(model)
    return sum_by(t.gear * t.gear * take(slope, scalar), _scalar_dofs(model), model.nv)


def _scalar_dofs(model: Model) -> np.ndarray:
    scalar, _ = scalar_outputs(model)
    return model.jnt_dofadr[_targets(model, scalar)]


def _targets(model: Model, outputs: np.ndarray) -> np.ndarray:
    """Joints or tendons on which forces act; static."""
    return model.actuator_trnid[model.structure.out_actuator[outputs], 0]


def _scalar(model: Model, qpos, ids: np.ndarray):
    """Lengths of actuators of joints with one degree of freedom, and their derivatives."""
    joints = _targets(model, ids)
    none = np.zeros(0, qpos.dtype)
    length, moment = per_joint(
        model.jnt_type[joints],
        ("transmission",),
        lambda joint: lambda q, gear: joint.transmission(q, gear, False),
        position_rows(model, qpos, joints),
        take(model.actuator_gear, ids),
        empty=(none, none[:, None]),
    )
    return length, moment[:, 0]


def _tendons(model: Model, kin: Kinematics, ids: np.ndarray):
    """Lengths and moments of actuators of tendons."""
    gear, tendon = take(model.actuator_gear[:, 0], ids), _targets(model, ids)
    if not len(ids):
        return gear, jnp.zeros((0, model.nv), gear.dtype)
    rows = take(tendon_jacobian(model, kin), tendon)
    return gear * take(kin.ten_length, tendon), gear[:, None] * rows


def _one(model: Model, kin: Kinematics, qpos, i: int):
    """Length and moment of one actuator of sites or of a joint with several degrees of freedom."""
    kind, gear = int(model.actuator_trntype[i]), model.actuator_gear[model.actuator_outadr[i]]
    target, reference = (int(k) for k in model.actuator_trnid[i])
    if kind == BODY:  # what its contacts give it is added in `forces`
        return jnp.zeros_like(gear[0]), jnp.zeros(model.nv, gear.dtype)
    if kind == SLIDERCRANK:
        rod = model.actuator_cranklength[i]
        return _slider_crank(model, kin, gear[0], rod, target, reference)
    if kind == SITE and reference < 0:
        return jnp.zeros_like(gear[0]), _site_row(model, kin, gear, target, kin.site_xmat[target])
    if kind == SO3:
        return _orientation(model, kin, qpos, target, reference)
    if kind == SITE:
        return _site_pair(model, kin, gear, target, reference)
    joint = JOINTS[int(model.jnt_type[target])]
    start, dof = model.jnt_qposadr[target], model.jnt_dofadr[target]
    q = qpos[start : start + joint.nq]
    length, moment = joint.transmission(q, gear, kind == JOINTINPARENT)
    return length, jnp.pad(moment, (dof, model.nv - dof - joint.nv))


def _site_pair(model: Model, kin: Kinematics, gear, site: int, reference: int):
    """Length and moment of an actuator that moves a site relative to a reference site."""
    mat, moved = kin.site_xmat[reference], kin.site_xpos[site] - kin.site_xpos[reference]
    turned = quat_difference(_site_quat(model, kin, reference), _site_quat(model, kin, site))
    length = (moved @ mat) @ gear[:3] + turned @ gear[3:]
    rows = [_site_row(model, kin, gear, s, mat) for s in (site, reference)]
    return length, jnp.where(_moves_both(model, site, reference), 0, rows[0] - rows[1])


def _moves_both(model: Model, *sites: int) -> np.ndarray:
    """(nv,) degrees of freedom that move two sites, and so not one relative to the other."""
    first, second = model.tree.moves[model.body_link[model.site_bodyid[list(sites)]]]
    return (first & second)[model.structure.dof_position]


def _orientation(model: Model, kin: Kinematics, qpos, target: int, reference: int):
    """Rotation vector (3,) of a ball joint or of a site relative to another site, and its moments.

    As in MuJoCo, the moments are torques about the axes of what is turned: the velocity that
    belongs to the lengths is the angular velocity in these axes, not the rate of the vector.
    """
    if reference < 0:
        start, dof = model.jnt_qposadr[target], model.jnt_dofadr[target]
        length = quat_log(quat_normalize(qpos[start : start + 4]))
        return length, jnp.eye(3, model.nv, dof, dtype=qpos.dtype)
    mat = kin.site_xmat[target]
    turned = quat_difference(_site_quat(model, kin, reference), _site_quat(model, kin, target))
    turning = [site_jacobian(model, kin, s)[1] for s in (target, reference)]
    both = jnp.asarray(_moves_both(model, target, reference))[None]
    return turned, jnp.where(both, 0, mat.T @ (turning[0] - turning[1]))


def _slider_crank(model: Model, kin: Kinematics, gear, rod, crank: int, slider: int):
    """Length and moment of an actuator that moves the end of a rod along a site's z axis.

    The rod's other end is at the site `crank`: the length x along the axis a solves
    `|d - x a| = rod`, where d points from the slider's site to the crank. Where the rod is too
    short, x is, as in MuJoCo, `d . a`.
    """
    axis, d = kin.site_xmat[slider, :, 2], kin.site_xpos[crank] - kin.site_xpos[slider]
    along = d @ axis
    square = along * along + rod * rod - d @ d
    reaches = square > 0
    height = jnp.sqrt(jnp.where(reaches, square, 1.0))
    share = jnp.where(reaches, 1 - along / height, 1.0)
    by_d = share * axis + jnp.where(reaches, d / height, 0)
    jacp, _ = site_jacobian(model, kin, crank)
    base, turning = site_jacobian(model, kin, slider)
    moment = by_d @ (jacp - base) + jnp.cross(axis, share * d) @ turning
    return gear * (along - jnp.where(reaches, height, 0)), gear * moment


def _site_row(model: Model, kin: Kinematics, gear, site: int, mat):
    """(nv,) generalised force of a force `gear[:3]` and torque `gear[3:]` in axes `mat`."""
    jacp, jacr = site_jacobian(model, kin, site)
    return (mat @ gear[:3]) @ jacp + (mat @ gear[3:]) @ jacr


def _site_quat(model: Model, kin: Kinematics, site: int):
    return quat_mul(kin.xquat[model.site_bodyid[site]], quat_normalize(model.site_quat[site]))
