"""Dry friction: a quadratic cost that is linear beyond the largest force."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float


@struct.dataclass
class Huber:
    """Cost `1/2 D r^2` for `|D r| < floss` and `floss (|r| - floss / (2 D))` beyond.

    Attributes:
        aref: Reference acceleration; the residual is `r = J x - aref`.
        D: Inverse regularisation `1 / R >= 0`. A row with `D = 0` contributes nothing.
        floss: Largest force `>= 0`. A row with `floss = 0` exerts no force.
    """

    aref: Float[Array, "*rows"]
    D: Float[Array, "*rows"]
    floss: Float[Array, "*rows"]

    def cost(self, r: Float[Array, "*rows"]) -> Float[Array, ""]:
        """Total cost of the rows at the residual r."""
        c = self._clipped(r)
        return jnp.sum(self.D * c * (r - 0.5 * c))

    def force(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """Force `-ds/dr` of every row, at most floss either way."""
        saturated = jnp.where(r < 0, self.floss, -self.floss)
        return jnp.where(self._sticks(r) | (self.D <= 0), -self.D * r, saturated)

    def curvature(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """Second derivative of the cost of every row."""
        return jnp.where(self._sticks(r), self.D, 0.0)

    def slopes(
        self, r: Float[Array, "*rows"], v: Float[Array, "*rows"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and second derivative of the cost at r along v."""
        return -jnp.sum(self.force(r) * v), jnp.sum(self.curvature(r) * v * v)

    def change(self, r: Float[Array, "*rows"], step: Float[Array, "*rows"]) -> Float[Array, ""]:
        """`cost(r + step) - cost(r)` without the cancellation of that difference.

        With c the clipped residual the cost is `D c (r - c / 2)`. Its difference is
        `D (mean(c) dr + dc mean(r - c))`, whose second term vanishes within one zone.
        """
        end = r + step
        before, after = self._clipped(r), self._clipped(end)
        outside = (r - before) + (end - after)
        return 0.5 * jnp.sum(self.D * ((before + after) * step + (after - before) * outside))

    def is_quadratic(self, r: Float[Array, "*rows"], end: Float[Array, "*rows"]) -> Bool[Array, ""]:
        """Whether no row changes zone; sliding in either direction and sticking are three zones."""
        return jnp.all(self._zone(r) == self._zone(end))

    def _zone(self, r: Float[Array, "*rows"]) -> Array:
        """0 where the row sticks, else the sign of r."""
        return jnp.where(self._sticks(r) | (self.D <= 0), 0.0, jnp.sign(r))

    def _sticks(self, r: Float[Array, "*rows"]) -> Array:
        return jnp.abs(self.D * r) < self.floss

    def _clipped(self, r: Float[Array, "*rows"]) -> Float[Array, "*rows"]:
        """The residual clipped to the quadratic zone; zero where D is zero."""
        bound = self.floss / jnp.where(self.D > 0, self.D, 1.0)
        return jnp.where(self._sticks(r), r, jnp.where(r < 0, -bound, bound))
