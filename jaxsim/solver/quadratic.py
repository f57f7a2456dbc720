"""Equality constraints: a quadratic cost."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float


@struct.dataclass
class Quadratic:
    """Cost `s(r) = 1/2 D r^2` of every row.

    Attributes:
        aref: Reference acceleration; the residual is `r = J x - aref`.
        D: Inverse regularisation `1 / R >= 0`. A row with `D = 0` contributes nothing.
    """

    aref: Float[Array, "*rows"]
    D: Float[Array, "*rows"]

    def cost(self, r: Float[Array, "*rows"]) -> Float[Array, ""]:
        """Total cost of the rows at the residual r."""
        return 0.5 * jnp.sum(self.D * r * r)

    def force(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """Force `-ds/dr` of every row."""
        return -self.D * r

    def curvature(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """Second derivative of the cost of every row."""
        return jnp.broadcast_to(self.D, r.shape)

    def slopes(
        self, r: Float[Array, "*rows"], v: Float[Array, "*rows"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and second derivative of the cost at r along v."""
        dv = self.D * v
        return jnp.sum(dv * r), jnp.sum(dv * v)

    def change(self, r: Float[Array, "*rows"], step: Float[Array, "*rows"]) -> Float[Array, ""]:
        """`cost(r + step) - cost(r)` without the cancellation of that difference."""
        return jnp.sum(self.D * step * (r + 0.5 * step))

    def is_quadratic(self, r: Float[Array, "*rows"], end: Float[Array, "*rows"]) -> Bool[Array, ""]:
        """True: the rows have one zone."""
        return jnp.ones((), bool)
