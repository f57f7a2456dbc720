"""Kinetic energy, and potential energy of gravity and springs.

Potential energy is that of MuJoCo's `mj_energyPos`: gravity on the bodies (without gravity
compensation, which counts as a force), springs of joints and springs of tendons.
"""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.polynomial import spring_energy
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import gravity
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia, tendon_inertia
from jaxsim.dynamics.velocity import Velocities
from jaxsim.joints import Joint
from jaxsim.joints.grouping import per_joint, position_rows
from jaxsim.model import Model

_SPRING_OFF = mujoco.mjtDisableBit.mjDSBL_SPRING


def kinetic_energy(
    model: Model, kin: Kinematics, vel: Velocities, qvel: Float[Array, "nv"]
) -> Float[Array, ""]:
    """`qvel . M qvel / 2` in joules, armature included, computed as a sum over the links."""
    links = jax.vmap(lambda inertia, v: inertia.kinetic_energy(v))(kin.inertia, vel.cvel)
    energy = links.sum() + 0.5 * (dof_armature(model) * qvel**2).sum()
    if not has_tendon_inertia(model):
        return energy
    return energy + 0.5 * qvel @ tendon_inertia(model, kin) @ qvel


def potential_energy(model: Model, kin: Kinematics, qpos: Float[Array, "nq"]) -> Float[Array, ""]:
    """Potential energy of gravity and, unless springs are disabled, of springs (J).

    Args:
      model: the model.
      kin: its kinematics.
      qpos: coordinates.
    """
    energy = gravity_energy(model, kin)
    if model.opt.disabled(_SPRING_OFF):
        return energy
    return energy + joint_spring_energy(model, qpos) + tendon_spring_energy(model, kin)


def gravity_energy(model: Model, kin: Kinematics) -> Float[Array, ""]:
    """`-sum_i m_i gravity . xipos_i` over all bodies except the world (J)."""
    return -(model.body_mass[1:] * (kin.xipos[1:] @ gravity(model))).sum()


def joint_spring_energy(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, ""]:
    """Energy of the joints' springs (J).

    The displacement of a ball joint is an angle, that of a free joint a distance and an angle.
    """

    def energy(joint: Joint):
        return lambda q, q0, k, poly: sum(
            spring_energy(k, poly, x) for x in joint.deflections(q, q0)
        )

    return per_joint(
        model.jnt_type,
        ("difference", "parts"),
        energy,
        *(position_rows(model, x) for x in (qpos, model.qpos_spring)),
        *(model.jnt_stiffness, model.jnt_stiffnesspoly),
        empty=qpos,
    ).sum()


def tendon_spring_energy(model: Model, kin: Kinematics) -> Float[Array, ""]:
    """Energy of the tendons' springs, which are slack within `tendon_lengthspring` (J)."""
    length = kin.ten_length
    low, high = model.tendon_lengthspring.T
    x = length - jnp.clip(length, low, high)
    springs = (model.tendon_stiffness, model.tendon_stiffnesspoly, x[:, None])
    return jax.vmap(spring_energy)(*springs).sum()
