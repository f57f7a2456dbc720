"""Rays against height fields: the surface, the four sides and the base below.

Between two crossings of grid lines, a ray is in one cell, whose two triangles are tested. So the
cost is proportional to the rows and columns, not to the number of cells.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.collision.rays.interval import Crossing, crossing
from jaxsim.collision.rays.primitives import box
from jaxsim.collision.rays.triangles import Triangles, nearest_triangle, triangle_crossing


def height_field(
    heights: Float[Array, "r c"],
    size: np.ndarray,
    p: Float[Array, "3"],
    d: Float[Array, "3"],
) -> Crossing:
    """Intersection of a ray with a height field, in its axes.

    Args:
      heights: heights of the points of the grid (m), rows along y.
      size: MuJoCo's `hfield_size`: half-lengths, largest height and depth of the base (m).
      p: start of the ray.
      d: direction of the ray.
    """
    base = jnp.asarray([size[0], size[1], size[3] / 2], p.dtype)
    below = crossing(box(base, p.at[2].add(size[3] / 2), d))
    found = [below, _surface(heights, size, p, d)]
    found += [_side(heights, size, p, d, axis, sign) for axis in (0, 1) for sign in (-1, 1)]
    t, leaving = (jnp.stack(x) for x in zip(*found, strict=True))
    nearest = jnp.argmin(t)
    return t[nearest], leaving[nearest]


def _surface(heights, size, p, d) -> Crossing:
    """Intersection with the surface, by the triangles of the cells below the ray."""
    count = np.array(heights.shape[::-1])
    step = 2 * size[:2] / (count - 1)
    cells = _cells(count, step, size, *jax.lax.stop_gradient((p, d)))
    column, row = cells.T
    x, y = column * step[0] - size[0], row * step[1] - size[1]
    corner = lambda i, j: jnp.stack(  # noqa: E731
        [x + i * step[0], y + j * step[1], heights[row + j, column + i]]
    )
    start, end = corner(0, 0), corner(1, 1)
    starts = jnp.concatenate([start, start], axis=1)
    firsts = jnp.concatenate([corner(1, 0) - start, end - start], axis=1)
    seconds = jnp.concatenate([end - start, corner(0, 1) - start], axis=1)
    triangles = Triangles(starts, firsts, seconds, jnp.cross(firsts, seconds, axis=0))
    spread = (jnp.broadcast_to(v[:, None], starts.shape) for v in (p, d))
    return triangle_crossing(triangles[nearest_triangle(triangles, *spread)], p, d)


def _cells(count: np.ndarray, step: np.ndarray, size, p, d):
    """Columns and rows of the cells of a ray between its crossings with the grid's lines."""
    times = []
    for axis in (0, 1):
        moving = jnp.abs(d[axis]) >= MINVAL
        lines = np.arange(count[axis]) * step[axis] - size[axis]
        t = (lines.astype(p.dtype) - p[axis]) / jnp.where(moving, d[axis], 1.0)
        times.append(jnp.where(moving, t, 0.0))
    times = jnp.sort(jnp.concatenate([jnp.zeros(1, p.dtype), *times]))
    middle = jnp.concatenate([(times[1:] + times[:-1]) / 2, times[-1:]])
    at = p[None, :2] + middle[:, None] * d[None, :2] + jnp.asarray(size[:2], p.dtype)[None]
    index = jnp.floor(at / jnp.asarray(step, p.dtype)[None]).astype(jnp.int32)
    return jnp.clip(index, 0, jnp.asarray(count - 2, jnp.int32)[None])


def _side(heights, size, p, d, axis: int, sign: int) -> Crossing:
    """Intersection with the wall below one of the edges of the surface."""
    other, edge = 1 - axis, -1 if sign > 0 else 0
    profile = heights[:, edge] if axis == 0 else heights[edge]
    moving = jnp.abs(d[axis]) > MINVAL
    t = (sign * size[axis] - p[axis]) / jnp.where(moving, d[axis], 1.0)
    at = p + t * d
    place = (at[other] + size[other]) * (len(profile) - 1) / (2 * size[other])
    first = jnp.clip(jnp.floor(place), 0, len(profile) - 2)
    index, part = first.astype(jnp.int32), place - first
    height = profile[index] * (1 - part) + profile[index + 1] * part
    hit = moving & (t >= 0) & (jnp.abs(at[other]) <= size[other])
    hit &= (at[2] >= 0) & (at[2] <= size[2]) & (at[2] < height)
    return jnp.where(hit, t, jnp.inf), sign * d[axis] > 0
