"""Anderson's acceleration of a fixed-point iteration `u <- G(u)`.

The next point is a combination of the last few values G(u). Its weights minimise the combination of
the residuals `F = G(u) - u` (Walker, Ni 2011, "Anderson acceleration for fixed-point iterations",
type II; for an affine G it is equivalent to GMRES).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxsim.batching.matrices import solve

WINDOW = 4
# Regularisation of the least-squares problem, in units of rounding.
_ROUNDING = 30.0
# The window is cleared if the residual grows by more than this factor.
_GROWTH = 1.0


class Memory(NamedTuple):
    """The last points and residuals.

    Attributes:
        steps: Differences of the last points, newest first; zeros for missing ones.
        changes: Differences of their residuals.
        point: The last point.
        residual: Its residual.
        begun: Whether there is a last point.
    """

    steps: Float[Array, "m n"]
    changes: Float[Array, "m n"]
    point: Float[Array, "n"]
    residual: Float[Array, "n"]
    begun: Bool[Array, ""]

    @classmethod
    def empty(cls, u: Float[Array, "n"]) -> "Memory":
        """An empty memory for points with the shape of u."""
        none = jnp.zeros((WINDOW, *u.shape), u.dtype)
        return cls(none, none, jnp.zeros_like(u), jnp.zeros_like(u), jnp.zeros((), bool))

    def next(
        self, u: Float[Array, "n"], g: Float[Array, "n"]
    ) -> tuple["Memory", Float[Array, "n"]]:
        """Add a point u and `g = G(u)`; return the new memory and the next point."""
        residual = g - u
        fine = self.begun & (_square(residual) <= _GROWTH**2 * _square(self.residual))
        steps, changes = (
            jnp.where(fine, jnp.concatenate([(new - old)[None], rows[:-1]]), 0.0)
            for new, old, rows in (
                (u, self.point, self.steps),
                (residual, self.residual, self.changes),
            )
        )
        weights = _least_squares(changes, residual)
        memory = Memory(steps, changes, u, residual, jnp.ones((), bool))
        return memory, g - weights @ (steps + changes)


def _least_squares(rows: Float[Array, "m n"], b: Float[Array, "n"]) -> Float[Array, "m"]:
    """Weights w that minimise `|w rows - b|`; zero for rows of zeros."""
    lengths = jnp.sqrt(jnp.sum(rows * rows, axis=1))
    safe = jnp.where(lengths > 0, lengths, 1.0)
    unit = rows / safe[:, None]
    ridge = _ROUNDING * jnp.finfo(b.dtype).eps
    gram = unit @ unit.T + jnp.diag(jnp.where(lengths > 0, ridge, 1.0))
    return solve(gram, unit @ b) / safe


def _square(x: Float[Array, "n"]) -> Float[Array, ""]:
    return jnp.sum(x * x)
