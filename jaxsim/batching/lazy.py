"""Lazy results of rules, which are computed at their first use."""

import dataclasses

import jax
from jax import lax


class Lazy:
    """A result that is computed at its first use by a rule that does not accept it as it is.

    Rules that accept a kind of lazy operand are registered with it, see `Primitive.takes`.
    """

    def force(self) -> jax.Array:
        """The array."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class LazyTranspose(Lazy):
    """A transposed array; products accept axes in any order.

    Attributes:
      array: the array.
      order: axis i of the transpose is axis `order[i]` of the array.
    """

    array: jax.Array
    order: tuple[int, ...]

    def force(self) -> jax.Array:
        """The transpose itself."""
        return lax.transpose(self.array, self.order)

    def labels(self, labels: tuple[int, ...]) -> tuple[int, ...]:
        """Labels of the array's axes, from those of the transpose's."""
        inverse = sorted(range(len(self.order)), key=self.order.__getitem__)
        return tuple(labels[i] for i in inverse)
