"""A block of constraint rows: its cost, its Jacobian, and what it is."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array

from jaxsim.constraint.jacobian import Jacobian
from jaxsim.solver import Kind


@struct.dataclass
class Block:
    """Rows of one kind.

    Attributes:
      kind: cost of the rows, with their reference accelerations and regularisation.
      jacobian: how the rows depend on the accelerations.
      violation: position-level violation of the rows, `efc_pos - efc_margin` in MuJoCo.
      velocity: velocity of the rows, `efc_vel`.
      name: what the rows are, static.
      ids: id of the element behind each entry along the first axis, static; empty for contacts.
    """

    kind: Kind
    jacobian: Jacobian
    violation: Array
    velocity: Array
    name: str = struct.field(pytree_node=False)
    ids: tuple[int, ...] = struct.field(pytree_node=False, default=())


def inverse_where(active, R):
    """`1 / R` where active, else zero: the row then contributes nothing."""
    return jnp.where(active, 1 / jnp.where(active, R, 1.0), 0.0)
