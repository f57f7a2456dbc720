"""Springs of joints and tendons."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.polynomial import poly_coefficient
from jaxsim.dynamics.tendon import tendon_force_on_joints, tendon_length
from jaxsim.joints.types import BALL, FREE
from jaxsim.model import Model
from jaxsim.spatial import quat_difference, quat_normalize

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING


def qfrc_spring(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, "nv"]:
    """Forces `-k(x) x` of all springs, x measured from `qpos_spring` in the joint's coordinates.

    The deflection of a ball joint, and of the rotation of a free joint, is a rotation vector; its
    length is what the stiffness polynomial depends on.
    """
    if model.opt.disabled(_SPRING):
        return jnp.zeros_like(model.dof_damping)
    force = _joint_springs(model, qpos)
    if model.ntendon:
        force = force + tendon_force_on_joints(model, _tendon_springs(model, qpos))
    return force


def _joint_springs(model: Model, qpos) -> Float[Array, "nv"]:
    parts, dofs = [jnp.zeros(0, qpos.dtype)], [np.zeros(0, int)]

    def add(joints, size: int, force, q_start: int = 0, v_start: int = 0):
        index = (model.jnt_qposadr[joints] + q_start)[:, None] + np.arange(size)
        parts.append(
            jax.vmap(force)(
                take(model.jnt_stiffness, joints),
                take(model.jnt_stiffnesspoly, joints),
                take(qpos, index.reshape(-1)).reshape(-1, size),
                take(model.qpos_spring, index.reshape(-1)).reshape(-1, size),
            ).reshape(-1)
        )
        count = min(size, 3)
        dofs.append(((model.jnt_dofadr[joints] + v_start)[:, None] + np.arange(count)).reshape(-1))

    scalar = np.nonzero((model.jnt_type != FREE) & (model.jnt_type != BALL))[0]
    if len(scalar):
        add(scalar, 1, lambda k, poly, q, q0: -poly_coefficient(k, poly, (q - q0)[0]) * (q - q0))
    if len(ball := np.nonzero(model.jnt_type == BALL)[0]):
        add(ball, 4, _rotation_spring)
    if len(free := np.nonzero(model.jnt_type == FREE)[0]):
        add(free, 3, lambda k, poly, q, q0: _vector_spring(k, poly, q - q0))
        add(free, 4, _rotation_spring, q_start=3, v_start=3)
    return take(jnp.concatenate(parts), np.argsort(np.concatenate(dofs)))


def _rotation_spring(stiffness, poly, q, q0) -> Float[Array, "3"]:
    return _vector_spring(stiffness, poly, quat_difference(q0, quat_normalize(q)))


def _vector_spring(stiffness, poly, x: Float[Array, "3"]) -> Float[Array, "3"]:
    """`-k(|x|) x`; at x = 0, where the length has no derivative, the derivative is `-k(0)`."""
    square = x @ x
    length = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    return -poly_coefficient(stiffness, poly, length) * x


def _tendon_springs(model: Model, qpos) -> Float[Array, "ntendon"]:
    """Slack inside the range `lengthspring`, `-k(x) x` beyond its ends."""
    length = tendon_length(model, qpos)
    lower, upper = model.tendon_lengthspring[:, 0], model.tendon_lengthspring[:, 1]
    beyond = jnp.where(length < lower, length - lower, 0.0)
    x = jnp.where(length > upper, length - upper, beyond)
    return -poly_coefficient(model.tendon_stiffness, model.tendon_stiffnesspoly, x) * x
