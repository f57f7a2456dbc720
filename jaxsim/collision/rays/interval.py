"""Intervals `(first, last)` of t in which a line `p + t d` is inside a convex shape.

An empty interval is `(inf, -inf)`. If a line does not move across a shape (at a speed below 1e-15,
as in MuJoCo), it is inside for all t or for none.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.constants import MINVAL

Interval = tuple[Float[Array, ""], Float[Array, ""]]
# Distance, infinite for a miss, and whether the ray comes from inside.
Crossing = tuple[Float[Array, ""], Bool[Array, ""]]


def ball(p: Float[Array, "n"], d: Float[Array, "n"], radius: Float[Array, ""] | float) -> Interval:
    """Interval with `|p + t d| <= radius`: a ball, or in two dimensions an infinite cylinder."""
    square = d @ d
    still = square < MINVAL
    square = jnp.where(still, 1.0, square)
    # Computed from the point closest to the centre, which is accurate in float32 for far rays.
    middle = jnp.where(still, 0.0, -(p @ d) / square)
    nearest = p + middle * d
    rest = radius**2 - nearest @ nearest
    missed = rest < 0
    half = jnp.sqrt(jnp.where(rest > 0, rest, 1.0) / square)
    half = jnp.where(rest > 0, half, 0.0)
    return _closed(missed, still, middle - half, middle + half)


def slab(p: Float[Array, ""], d: Float[Array, ""], half: Float[Array, ""]) -> Interval:
    """Interval with `|p + t d| <= half`."""
    still = jnp.abs(d) < MINVAL
    speed = jnp.where(still, 1.0, d)
    one, two = (-half - p) / speed, (half - p) / speed
    missed = still & (jnp.abs(p) > half)
    return _closed(missed, still, jnp.minimum(one, two), jnp.maximum(one, two))


def _closed(missed, still, first, last) -> Interval:
    first, last = jnp.where(still, -jnp.inf, first), jnp.where(still, jnp.inf, last)
    return jnp.where(missed, jnp.inf, first), jnp.where(missed, -jnp.inf, last)


def common(*intervals: Interval) -> Interval:
    """The intersection of intervals."""
    first, last = zip(*intervals, strict=True)
    return jnp.stack(first).max(), jnp.stack(last).min()


def hull(*intervals: Interval) -> Interval:
    """The smallest interval that contains all intervals; empty ones are ignored."""
    first, last = zip(*intervals, strict=True)
    empty = [a > b for a, b in intervals]
    first = [jnp.where(e, jnp.inf, a) for e, a in zip(empty, first, strict=True)]
    last = [jnp.where(e, -jnp.inf, b) for e, b in zip(empty, last, strict=True)]
    return jnp.stack(first).min(), jnp.stack(last).max()


def meets(interval: Interval) -> Bool[Array, ""]:
    """Whether the interval contains some `t >= 0`."""
    first, last = interval
    return (first <= last) & (last >= 0)


def crossing(interval: Interval) -> Crossing:
    """Parameter t at which the ray enters the shape, or leaves it if it starts inside."""
    leaving = interval[0] < 0
    t = jnp.where(leaving, interval[1], interval[0])
    return jnp.where(meets(interval), t, jnp.inf), leaving
