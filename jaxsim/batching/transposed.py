"""Transposes that wait for their use: a product takes its operands with the axes in any order."""

import dataclasses

import jax
from jax import lax


@dataclasses.dataclass(frozen=True)
class Transposed:
    """An array with its axes in another order.

    Attributes:
      array: the array.
      order: axis i of the transpose is axis `order[i]` of the array.
    """

    array: jax.Array
    order: tuple[int, ...]

    def assemble(self) -> jax.Array:
        """The transpose itself."""
        return lax.transpose(self.array, self.order)

    def labels(self, labels: tuple[int, ...]) -> tuple[int, ...]:
        """Labels of the array's axes, from those of the transpose's."""
        place = sorted(range(len(self.order)), key=self.order.__getitem__)
        return tuple(labels[i] for i in place)
