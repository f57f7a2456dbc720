"""What costs of contacts have in common, apart from the cost of one contact."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class OneContact(NamedTuple):
    """Functions of one contact's parameters and residual, named as the methods of `Kind`."""

    cost: Callable
    force: Callable
    curvature: Callable
    slopes: Callable
    change: Callable
    is_quadratic: Callable


class ContactCost:
    """The cost of n contacts of the same dimension d, as the sum over the contacts.

    A subclass gives the functions of one contact and their parameters by `_one_contact`.
    """

    def cost(self, r: Float[Array, "n d"]) -> Float[Array, ""]:
        """Total cost of the contacts at the residual r."""
        return jnp.sum(self._map("cost", r))

    def force(self, r: Float[Array, "n d"]) -> Float[Array, "n d"]:
        """Force `-ds/dr` of every contact."""
        return self._map("force", r)

    def curvature(self, r: Float[Array, "n d"]) -> Float[Array, "n d d"]:
        """Hessian of the cost of every contact, positive semidefinite."""
        return self._map("curvature", r)

    def slopes(
        self, r: Float[Array, "n d"], v: Float[Array, "n d"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and second derivative of the cost at r along v."""
        first, second = self._map("slopes", r, v)
        return jnp.sum(first), jnp.sum(second)

    def change(self, r: Float[Array, "n d"], step: Float[Array, "n d"]) -> Float[Array, ""]:
        """`cost(r + step) - cost(r)` without the cancellation of that difference."""
        return jnp.sum(self._map("change", r, step))

    def is_quadratic(self, r: Float[Array, "n d"], end: Float[Array, "n d"]) -> Bool[Array, ""]:
        """Whether the cost of every contact is one quadratic from r to end."""
        return jnp.all(self._map("is_quadratic", r, end))

    def _one_contact(self) -> tuple[OneContact, tuple[Array, ...]]:
        """The functions of one contact, and their first arguments for every contact."""
        raise NotImplementedError

    def _map(self, name: str, *rows):
        functions, parameters = self._one_contact()
        return jax.vmap(getattr(functions, name))(*parameters, *rows)
