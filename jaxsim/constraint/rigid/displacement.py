"""What moves bodies within a step besides their mean velocity: impacts, and errors of positions.

Impulses displace by the time that is left when they act (`jaxsim.constraint.rigid.impact`).

Penetration, which rounding and turning bodies leave, is taken away by moving bodies, not by giving
them a speed. Depths of several contacts of a body seldom fit together: as velocities they would
jam what friction holds, and they would throw bodies into the air.
"""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.constraint.rigid.impact import Approach, Impact
from jaxsim.solver import Kind, Operator
from jaxsim.solver.operator import Rows

# The part by which penetration is reduced in a step.
_CORRECTION = 0.1
# Depths below it are none (m).
_NOTHING = 1e-15
# An impulse is that of one contact if it is less than this many times what a mean inertia needs.
_ALONE = 2.0

Contacts = Sequence[tuple[int, Approach, Impact]]
"""Index of each block of contacts, its approach and its impacts."""

Held = Sequence[tuple[int, Array, Array]]
"""Index of each block of rows that hold joints, their errors and inverse inertias."""


def displacement(
    h: Float[Array, ""],
    contacts: Contacts,
    held: Held,
    kinds: Sequence[Kind],
    forces: Rows,
    operator: Operator,
) -> Float[Array, "nv"]:
    """What is added to the path at the mean velocity of a step.

    Args:
      h: length of the step.
      contacts: the contacts.
      held: rows that hold joints.
      kinds: cost of each block.
      forces: of the rows of all blocks.
      operator: mass matrix and Jacobian.
    """
    late = _late(h, contacts, forces)
    wanted, size = _wanted(contacts, held, kinds, forces)
    pushes = [jnp.zeros_like(force) for force in forces]
    for i, (c, inertia) in wanted.items():
        pushes[i] = c / size * inertia
    # Two right-hand sides, one factor.
    pulls = jnp.stack([operator.pull(late), operator.pull(tuple(pushes))])
    both = jax.vmap(operator.unconstrained)(pulls)
    by_impacts, y = (jax.tree.map(lambda x: x[i], both) for i in range(2))  # noqa: B023
    share = _best_multiple(wanted, pushes, operator.rows(y))
    return operator.vector(by_impacts) + share * size * operator.vector(y)


def _late(h: Float[Array, ""], contacts: Contacts, forces: Rows) -> Rows:
    """The impulses times the time for which they displace."""
    late = [jnp.zeros_like(force) for force in forces]
    for i, at, found in contacts:
        change = at.inverse_weight * h * forces[i][:, 0]
        alone = _ALONE * found.change / jnp.where(change > 0, change, 1.0)
        lever = found.lever * jnp.minimum(alone, 1.0)
        late[i] = h * lever[:, None] * forces[i]
    return tuple(late)


def _wanted(contacts: Contacts, held: Held, kinds: Sequence[Kind], forces: Rows):
    """The displacements c that rows ask for with their inertias `1 / w`, and the largest c.

    Contacts ask for a tenth of their depth, rows that hold joints for minus their errors.
    """
    wanted = {i: (-error, 1 / w) for i, error, w in held}
    for i, at, _ in contacts:
        depth = jnp.where(kinds[i].D[:, 0] > 0, jnp.maximum(-at.dist, 0.0), 0.0)
        normal = jnp.zeros_like(forces[i]).at[:, 0].set(_CORRECTION * depth)
        wanted[i] = normal, jnp.where(normal > 0, 1 / at.inverse_weight[:, None], 0.0)
    # In units of the largest, for squares of small numbers would vanish; it has no derivative.
    largest = [jnp.max(jnp.abs(c), initial=0) for c, _ in wanted.values()]
    size = lax.stop_gradient(functools.reduce(jnp.maximum, largest))
    return wanted, jnp.where(size > _NOTHING, size, 1.0)


def _best_multiple(wanted, pushes: Sequence[Array], moved: Rows) -> Float[Array, ""]:
    """The multiple of `d = M^-1 J^T (c / w)` that minimises `sum (J d - c)^2 / w`."""
    promised = needed = jnp.zeros(())
    for i, (_, inertia) in wanted.items():
        promised = promised + jnp.sum(pushes[i] * moved[i])
        needed = needed + jnp.sum(moved[i] * moved[i] * inertia)
    some = needed > 0
    return jnp.where(some, promised / jnp.where(some, needed, 1.0), 0.0)
