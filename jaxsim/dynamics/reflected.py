"""Reflected damping and armature: those of actuators at the joints and tendons that they drive.

Behind a gear ratio g, a coefficient of the motor is multiplied by `g^2`.
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.model import Model

_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_TENDON = (int(mujoco.mjtTrn.mjTRN_TENDON),)


def dof_armature(model: Model) -> Float[Array, "nv"]:
    """Armature of each degree of freedom with that of its actuators (kg or kg m^2)."""
    return model.dof_armature + _on_dofs(model, model.actuator_armature)


def tendon_armature(model: Model) -> Float[Array, "ntendon"]:
    """Armature of each tendon with that of its actuators (kg)."""
    motors = _on_targets(model, model.actuator_armature, _TENDON, model.ntendon)
    return model.tendon_armature + motors


def dof_damping(model: Model) -> tuple[Float[Array, "nv"], Float[Array, "nv npoly"]]:
    """Linear and polynomial damping of each degree of freedom with that of its actuators."""
    return (
        model.dof_damping + _on_dofs(model, model.actuator_damping),
        model.dof_dampingpoly + _on_dofs(model, model.actuator_dampingpoly),
    )


def tendon_damping(model: Model) -> tuple[Float[Array, "ntendon"], Float[Array, "ntendon npoly"]]:
    """Linear and polynomial damping of each tendon with that of its actuators."""
    return (
        model.tendon_damping + _on_targets(model, model.actuator_damping, _TENDON, model.ntendon),
        model.tendon_dampingpoly
        + _on_targets(model, model.actuator_dampingpoly, _TENDON, model.ntendon),
    )


def _on_dofs(model: Model, coefficient):
    """Sums over the actuators of each joint, the same for all its degrees of freedom."""
    return take(_on_targets(model, coefficient, _JOINT, model.njnt), model.dof_jntid)


def _on_targets(model: Model, coefficient, kinds: tuple[int, ...], n: int):
    (ids,) = np.nonzero(np.isin(model.actuator_trntype, kinds))
    gear = take(model.actuator_gear[:, 0], model.actuator_outadr[ids])
    share = take(coefficient, ids) * (gear * gear).reshape(-1, *[1] * (coefficient.ndim - 1))
    if not len(ids):
        return jnp.zeros((n, *coefficient.shape[1:]), coefficient.dtype)
    return sum_by(share, model.actuator_trnid[ids, 0], n)
