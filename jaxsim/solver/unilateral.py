"""Unilateral constraints, which may only push: limits and frictionless contacts."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float


@struct.dataclass
class Unilateral:
    """Cost `s(r) = 1/2 D min(r, 0)^2` of every row.

    Attributes:
        aref: Reference acceleration; the residual is `r = J x - aref`.
        D: Inverse regularisation `1 / R >= 0`. A row with `D = 0` contributes nothing.
    """

    aref: Float[Array, "*rows"]
    D: Float[Array, "*rows"]

    def cost(self, r: Float[Array, "*rows"]) -> Float[Array, ""]:
        """Total cost of the rows at the residual r."""
        return 0.5 * jnp.sum(self.curvature(r) * r * r)

    def force(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """Force `-ds/dr >= 0` of every row."""
        return -self.curvature(r) * r

    def curvature(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """Second derivative of the cost of every row."""
        return jnp.where(r < 0, self.D, 0.0)

    def slopes(
        self, r: Float[Array, "*rows"], v: Float[Array, "*rows"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and second derivative of the cost at r along v."""
        dv = self.curvature(r) * v
        return jnp.sum(dv * r), jnp.sum(dv * v)

    def change(self, r: Float[Array, "*rows"], step: Float[Array, "*rows"]) -> Float[Array, ""]:
        """`cost(r + step) - cost(r)` without the cancellation of that difference."""
        return 0.5 * jnp.sum(self.D * change_of_square(r, step))

    def is_quadratic(self, r: Float[Array, "*rows"], end: Float[Array, "*rows"]) -> Bool[Array, ""]:
        """Whether no row changes zone from r to end."""
        return jnp.all(self.curvature(r) == self.curvature(end))


def change_of_square(r: Float[Array, "*rows"], step: Float[Array, "*rows"]):
    """`min(r + step, 0)^2 - min(r, 0)^2` without the cancellation of that difference.

    With `c = min(r, 0)` the square is `c (2 r - c)`. Its difference is twice
    `mean(c) dr + dc mean(r - c)`, whose second term vanishes where both ends are active.
    """
    end = r + step
    before, after = jnp.minimum(r, 0), jnp.minimum(end, 0)
    outside = (r - before) + (end - after)
    return (before + after) * step + (after - before) * outside
