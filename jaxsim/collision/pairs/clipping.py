"""The intersection of two convex polygons in a plane, with a fixed number of corners.

Each edge of the intersection lies on an edge of one of the polygons, and each corner of it is the
start of one of its edges. So there is one possible corner for each edge of both polygons.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.norms import safe_norm


def overlap_corners(
    first: Float[Array, "m 2"], second: Float[Array, "n 2"], size: Float[Array, ""]
) -> tuple[Float[Array, "m+n 2"], Bool[Array, "m+n"]]:
    """Corners of the intersection of two polygons.

    Args:
      first: corners of a convex polygon, counterclockwise; repeated corners count once.
      second: another such polygon, or a line segment as a polygon with two different corners.
      size: length scale of the polygons for rounding errors.

    Returns:
      Points, and whether each is a corner of the intersection; each corner occurs once.
    """
    small = 64 * float(jnp.finfo(first.dtype).eps) * size
    # Where edges of both polygons coincide, only the corner of the second is kept.
    start1, exists1 = _entries(first, second, -small, small)
    start2, exists2 = _entries(second, first, small, small)
    return jnp.concatenate([start1, start2]), jnp.concatenate([exists1, exists2])


def _entries(subject, window, slack: Float[Array, ""], small: Float[Array, ""]):
    """The points where the edges of a polygon enter another one, and whether each does.

    An edge is clipped by the line of each edge of the other polygon (Cyrus and Beck, "Generalized
    two- and three-dimensional clipping", 1978). An edge on the border, or outside by less than the
    slack, counts as inside; with a negative slack it counts as outside.
    """
    step, side = (jnp.roll(x, -1, axis=0) - x for x in (subject, window))
    length, width = (jax.vmap(safe_norm)(x) for x in (step, side))
    regular = width > small
    out = jnp.stack([side[:, 1], -side[:, 0]], axis=1)
    out = jnp.where(regular[:, None], out / jnp.where(regular, width, 1)[:, None], 0)
    height = subject @ out.T - jnp.sum(window * out, axis=1)[None]
    slope = step @ out.T
    level = jnp.abs(slope) <= small
    crossing = -height / jnp.where(level, 1, slope)
    begin = jnp.max(jnp.where(~level & (slope < 0), crossing, 0), axis=1)
    end = jnp.min(jnp.where(~level & (slope > 0), crossing, 1), axis=1)
    begin, end = jnp.clip(begin, 0, 1), jnp.minimum(end, 1)
    beside = jnp.any(level & regular[None] & (height > slack), axis=1)
    exists = (length > small) & ((end - begin) * length > small) & ~beside
    return subject + begin[:, None] * step, exists
