"""Lazy results of rules: computed at their first use, unless that takes them as they are."""

import dataclasses

import jax
from jax import lax


class Lazy:
    """A result that is computed at its first use, unless that takes it as it is.

    A rule may return one; rules that take it say so where they are registered.
    """

    def force(self) -> jax.Array:
        """The array."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class LazyTranspose(Lazy):
    """An array with its axes in another order: a product takes it in any.

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
