"""Energy: kinetic, and the potential of gravity and springs.

The potential is MuJoCo's `mj_energyPos`: gravity on the bodies' masses (without gravity
compensation, which does work as a force), springs of joints and springs of tendons.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import gravity
from jaxsim.dynamics.tendon import tendon_length
from jaxsim.dynamics.velocity import Velocities
from jaxsim.joints.types import BALL, FREE
from jaxsim.model import Model
from jaxsim.spatial import quat_difference, quat_normalize

_SPRING_OFF = mujoco.mjtDisableBit.mjDSBL_SPRING


def kinetic_energy(
    model: Model, kin: Kinematics, vel: Velocities, qvel: Float[Array, "nv"]
) -> Float[Array, ""]:
    """`qvel . M qvel / 2` in joules, armature included, as a sum over the links."""
    links = jax.vmap(lambda inertia, v: inertia.kinetic_energy(v))(kin.inertia, vel.cvel)
    return links.sum() + 0.5 * (dof_armature(model) * qvel**2).sum()


def potential_energy(model: Model, kin: Kinematics, qpos: Float[Array, "nq"]) -> Float[Array, ""]:
    """Potential energy in joules of gravity and of the springs that the options leave on.

    Args:
      model: the model.
      kin: its kinematics.
      qpos: coordinates.
    """
    energy = gravity_energy(model, kin)
    if model.opt.disabled(_SPRING_OFF):
        return energy
    return energy + joint_spring_energy(model, qpos) + tendon_spring_energy(model, qpos)


def gravity_energy(model: Model, kin: Kinematics) -> Float[Array, ""]:
    """`-sum_i m_i gravity . xipos_i` over all bodies, welded ones included."""
    return -(model.body_mass[1:] * (kin.xipos[1:] @ gravity(model))).sum()


def joint_spring_energy(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, ""]:
    """Energy of the springs that pull the joints to `qpos_spring`.

    A ball joint is deflected by an angle; a free joint by a distance and by an angle.
    """
    kind = model.jnt_type
    (free,), (turning,) = np.nonzero(kind == FREE), np.nonzero((kind == FREE) | (kind == BALL))
    (scalar,) = np.nonzero((kind != FREE) & (kind != BALL))
    energy = _deflection_energy(model, qpos, scalar, 0, 1, jnp.subtract)
    energy += _deflection_energy(model, qpos, free, 0, 3, jnp.subtract)
    start = np.where(kind[turning] == FREE, 3, 0)
    return energy + _deflection_energy(model, qpos, turning, start, 4, _turn)


def tendon_spring_energy(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, ""]:
    """Energy of the tendons' springs, which are slack inside `tendon_lengthspring`."""
    length = tendon_length(model, qpos)
    low, high = model.tendon_lengthspring.T
    x = length - jnp.clip(length, low, high)
    springs = (model.tendon_stiffness, model.tendon_stiffnesspoly, x[:, None])
    return jax.vmap(spring_potential)(*springs).sum()


def spring_potential(
    stiffness: Float[Array, ""], poly: Float[Array, "npoly"], x: Float[Array, "n"]
) -> Float[Array, ""]:
    """`k x^2/2 + p_0 x^3/3 + p_1 x^4/4 + ...`: work against the force `x (k + p_0 x + ...)`.

    Args:
      stiffness: k.
      poly: coefficients of the higher powers.
      x: the deflection; several components count by their length, a single one with its sign.
    """
    square = x @ x
    length = x[0] if len(x) == 1 else _root(square)
    energy = 0.5 * stiffness * square
    for k, coefficient in enumerate(poly, start=3):
        # Even powers avoid the root, which has no derivative at zero.
        energy += coefficient / k * square ** (k // 2) * (length if k % 2 else 1)
    return energy


def _deflection_energy(model: Model, qpos, joints, start, width: int, difference):
    """Energy of springs on `width` coordinates of some joints."""
    address = (model.jnt_qposadr[joints] + start)[:, None] + np.arange(width)
    q, q0 = (take(x, address.ravel()).reshape(address.shape) for x in (qpos, model.qpos_spring))
    springs = (take(model.jnt_stiffness, joints), take(model.jnt_stiffnesspoly, joints))
    return jax.vmap(spring_potential)(*springs, jax.vmap(difference)(q, q0)).sum()


def _turn(q, q0):
    return quat_difference(q0, quat_normalize(q))


def _root(square):
    """Square root with derivative zero at zero."""
    zero = square == 0
    return jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, square)))
