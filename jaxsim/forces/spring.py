"""Springs of joints and tendons."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.polynomial import poly_coefficient, spring_force
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tendons.tendon import tendon_force_on_joints
from jaxsim.joints import Joint
from jaxsim.joints.grouping import per_joint, position_rows
from jaxsim.model import Model

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING


def qfrc_spring(model: Model, kin: Kinematics, qpos: Float[Array, "nq"]) -> Float[Array, "nv"]:
    """Generalised forces `-k(|x|) x` of all springs; x is the displacement from `qpos_spring`.

    The displacement of a rotation is a rotation vector. A free joint has two springs, for its
    translation and its rotation, see `Joint.parts`.
    """
    if model.opt.disabled(_SPRING):
        return jnp.zeros_like(model.dof_damping)
    force = _joint_springs(model, qpos)
    if model.ntendon:
        force = force + tendon_force_on_joints(model, kin, _tendon_springs(model, kin))
    return force


def _joint_springs(model: Model, qpos) -> Float[Array, "nv"]:
    def force(joint: Joint):
        return lambda q, q0, k, poly: jnp.concatenate(
            [spring_force(k, poly, x) for x in joint.deflections(q, q0)]
        )

    return per_joint(
        model.jnt_type,
        ("difference", "parts"),
        force,
        *(position_rows(model, x) for x in (qpos, model.qpos_spring)),
        *(model.jnt_stiffness, model.jnt_stiffnesspoly),
        empty=qpos,
        start=model.jnt_dofadr,
    )


def _tendon_springs(model: Model, kin: Kinematics) -> Float[Array, "ntendon"]:
    """Forces `-k(x) x`, where x is how far the length is outside the range `lengthspring`."""
    length = kin.ten_length
    lower, upper = model.tendon_lengthspring[:, 0], model.tendon_lengthspring[:, 1]
    beyond = jnp.where(length < lower, length - lower, 0.0)
    x = jnp.where(length > upper, length - upper, beyond)
    return -poly_coefficient(model.tendon_stiffness, model.tendon_stiffnesspoly, x) * x
