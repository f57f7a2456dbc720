"""The point closest to the origin on the triangles that a new corner makes with three others."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def closest_with(
    new: Float[Array, "3"], old: Float[Array, "3 3"]
) -> tuple[Float[Array, "3"], Float[Array, "3"], Int[Array, ""]]:
    """The closest point to the origin of the triangles of a new corner and two of three old ones.

    Edges between two old corners are left out: the new corner is closer, or equal to one of them.
    Corners may coincide.

    Args:
      new: the new corner.
      old: rows are the old corners.

    Returns:
      The point, its weights on the new corner and on the old ones k and k + 1 (mod 3), and k.
    """
    first, second = old - new[None], jnp.roll(old, -1, axis=0) - new[None]
    along = _on_segments(new, first)
    inside, height, regular = _on_planes(new, first, second)
    points = jnp.concatenate([new[None] + along[:, None] * first, height])
    square = jnp.sum(points**2, axis=1)
    square = jnp.where(jnp.concatenate([jnp.ones(3, bool), regular]), square, jnp.inf)
    none = jnp.zeros_like(along)
    weights = jnp.concatenate([jnp.stack([1 - along, along, none], axis=1), inside])
    # The first among equals: an edge is preferred to a triangle.
    best = square == jnp.min(square)
    best = best & (jnp.cumsum(best) == 1)
    pick = lambda x: jnp.sum(jnp.where(best[:, None], x, 0), axis=0)  # noqa: E731
    k = jnp.sum(jnp.where(best, jnp.array([0, 1, 2, 0, 1, 2], jnp.int32), 0), dtype=jnp.int32)
    return pick(points), pick(weights), k


def _on_segments(new: Float[Array, "3"], edge: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Parameters t in [0, 1] of the closest points on `new + t edge`."""
    square = jnp.sum(edge**2, axis=1)
    return jnp.clip(-(edge @ new) / jnp.where(square > 0, square, 1), 0, 1)


def _on_planes(new, first, second):
    """Weights and closest points on the triangles' planes, and whether they are inside."""
    normal = jnp.cross(first, second)
    square = jnp.sum(normal**2, axis=1)
    safe = jnp.where(square > 0, square, 1)
    p, q = jnp.cross(new[None], normal), normal / safe[:, None]
    # With x = new and m = first x second the weights are `(x x m) . second / m^2` on the first and
    # `-(x x m) . first / m^2` on the second.
    one, two = jnp.sum(p * second, axis=1) / safe, -jnp.sum(p * first, axis=1) / safe
    inside = (square > 0) & (one >= 0) & (two >= 0) & (one + two <= 1)
    weights = jnp.stack([1 - one - two, one, two], axis=1)
    return weights, (normal @ new)[:, None] * q, inside
