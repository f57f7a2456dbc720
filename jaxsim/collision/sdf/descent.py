"""The deepest points of a body B in a body A.

They minimise the signed distance f to A over B. From each start a projected gradient descent takes
a fixed number of steps

    x' = P(x - s grad f(x))

where P is the nearest point of B, and s follows Barzilai and Borwein ("Two-point step size gradient
methods", 1988); a step that does not descend is taken back and shortened. What it finds is a fixed
point of this map with any s. A Newton step on that equation refines it and gives its derivatives by
the implicit function theorem. Directions along which the fixed point is free, as on faces that lie
on each other, are held.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

Point = Float[Array, "3"]

ITERATIONS = 24
# Bounds of the step, in sizes of the smaller shape, and how much a failed step is shortened.
SHORTEST, LONGEST, SHORTENED = 1e-3, 30.0, 0.25
# Residual of a fixed point, and the largest refinement, in sizes of the smaller shape.
STATIONARY, TRUSTED = 1e-3, 0.05


class Region(NamedTuple):
    """A body as two functions.

    Attributes:
      distance: from a point to its signed distance (m).
      nearest: from a point to the nearest point of the body.
    """

    distance: Callable[[Point], Float[Array, ""]]
    nearest: Callable[[Point], Point]


def nearest_by(distance: Callable[[Point], Float[Array, ""]]) -> Callable[[Point], Point]:
    """The nearest point of a body, from its signed distance."""

    def nearest(x):
        value, slope = jax.value_and_grad(distance)(x)
        square = slope @ slope
        return x - jnp.maximum(value, 0.0) * slope / jnp.where(square > 0, square, 1.0)

    return nearest


def descend(a: Region, b: Region, start: Point, scale) -> Point:
    """The point of B with a local minimum of the distance to A; it has no derivatives.

    Args:
      a: A.
      b: B.
      start: where to start.
      scale: size of the smaller body (m).
    """

    def at(x):
        value, slope = jax.value_and_grad(a.distance)(x)
        slope = jnp.where(jnp.isfinite(slope), slope, 0.0)
        return value + jnp.maximum(b.distance(x), 0.0), slope

    def step(_, carry):
        x, value, slope, s = carry
        new = b.nearest(x - s * slope)
        new_value, new_slope = at(new)
        dx, bent = new - x, (new - x) @ (new_slope - slope)
        better = new_value < value
        longer = jnp.where(bent > 0, dx @ dx / jnp.where(bent > 0, bent, 1.0), LONGEST * scale)
        s = jnp.where(better, longer, SHORTENED * s)
        s = jnp.clip(s, SHORTEST * scale, LONGEST * scale)
        kept = (new, new_value, new_slope), (x, value, slope)
        return (*(jnp.where(better, p, q) for p, q in zip(*kept, strict=True)), s)

    x = b.nearest(start)
    return lax.fori_loop(0, ITERATIONS, step, (x, *at(x), scale))[0]


def refine(
    a: Region, b: Region, held: tuple[Region, Region], x: Point, scale
) -> tuple[Point, Bool[Array, ""]]:
    """The fixed point near x with its derivatives, and whether x was one.

    Args:
      a: A.
      b: B.
      held: A and B without derivatives.
      x: a point close to the fixed point.
      scale: size of the smaller body (m).
    """

    def moved(a: Region, b: Region, x):
        return b.nearest(x - scale * jax.grad(a.distance)(x))

    M = jnp.eye(3, dtype=x.dtype) - jax.jacfwd(lambda x: moved(*held, x))(x)
    # A direction is free if the map moves it by less than this fraction.
    free = float(jnp.finfo(x.dtype).eps) ** (1 / 3)
    solve = _inverse(M.T @ M + free**2 * jnp.eye(3, dtype=x.dtype)) @ M.T
    residual = moved(a, b, x) - x
    solve = jnp.where(jnp.isfinite(solve), solve, 0.0)
    step = solve @ jnp.where(jnp.isfinite(residual), residual, 0.0)
    small = lambda v, limit: lax.stop_gradient(v @ v) < (limit * scale) ** 2  # noqa: E731
    still = small(residual, STATIONARY)
    return b.nearest(x + jnp.where(still & small(step, TRUSTED), step, 0.0)), still


def _inverse(A: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The inverse of a matrix by cross products of its rows."""
    a, b, c = A
    adjugate = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)], axis=1)
    return adjugate / (a @ adjugate[:, 0])
