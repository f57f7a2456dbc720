"""Inverse inertia of constraint rows, the diagonal of `A = J M^-1 J^T`.

By default it is approximated by numbers of the reference configuration, `body_invweight0` and the
like. With the flag `diagexact` it is exact at each position (MuJoCo documentation, chapter
"Computation", section "Diagonal approximation").
"""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.constraint.jacobian import Jacobian
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.motion import Motion
from jaxsim.model.dof_order import to_tree_order

_DIAGEXACT = mujoco.mjtEnableBit.mjENBL_DIAGEXACT


def with_inverse_mass(motion: Motion) -> Motion:
    """The motion with the inverse of its mass matrix, in tree order, if rows need it."""
    model = motion.model
    if not model.opt.enabled(_DIAGEXACT):
        return motion
    columns = jnp.eye(model.nv, dtype=motion.qvel.dtype)
    inverse = jax.vmap(lambda force: solve_mass(model, motion.kin, force))(columns)
    return motion.replace(inverse_mass=to_tree_order(model, to_tree_order(model, inverse).T))


def row_inertia(motion: Motion, jacobian: Jacobian, approximation: Array) -> Array:
    """Inverse inertia of each row: the approximation, or the exact one if the model asks for it."""
    if motion.inverse_mass is None:
        return approximation
    return _quadratic(motion.inverse_mass, _dense(motion, jacobian))


def contact_inertia(
    motion: Motion,
    jacobian: Jacobian,
    approximation: Float[Array, "n"],
    friction: Float[Array, "n 5"] | None,
) -> Float[Array, "n"]:
    """Inverse inertia of contacts, each along one direction.

    Args:
      motion: position and velocity.
      jacobian: the rows of the contacts.
      approximation: what it is without `diagexact`.
      friction: of contacts with pyramidal cones, whose direction is the first edge
        `n + friction[0] t`, made a unit vector; None for the normal.
    """
    if motion.inverse_mass is None:
        return approximation
    rows = _dense(motion, jacobian)
    if friction is None:
        return _quadratic(motion.inverse_mass, rows[:, 0])
    mu = friction[:, :1]
    return _quadratic(motion.inverse_mass, rows[:, 0] + mu * rows[:, 1]) / (1 + mu[:, 0] ** 2)


def _dense(motion: Motion, jacobian: Jacobian) -> Array:
    return jacobian.dense(motion.model.tree, motion.kin.cdof)


def _quadratic(
    inverse_mass: Float[Array, "nv nv"], J: Float[Array, "*rows nv"]
) -> Float[Array, "*rows"]:
    """The diagonal of `J M^-1 J^T`."""
    return jnp.sum((J @ inverse_mass) * J, axis=-1)
