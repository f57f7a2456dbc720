"""The common part of a rectangle and a parallelogram in a plane, in a fixed number of corners.

Each corner of the common part is where one of its edges begins, and each edge of it lies on one of
the eight edges of the two figures. So there is one place for each of these, and no list to keep.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

# Corners of the square [-1, 1]^2, counterclockwise, and the vectors to the next ones.
_CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
_EDGES = np.roll(_CORNERS, -1, axis=0) - _CORNERS


def overlap_corners(
    half: Float[Array, "2"], centre: Float[Array, "2"], u: Float[Array, "2"], v: Float[Array, "2"]
) -> tuple[Float[Array, "8 2"], Bool[Array, "8"]]:
    """Corners of the common part of two figures.

    Args:
      half: half-lengths of a rectangle around the origin.
      centre: centre of a parallelogram.
      u: half of one of its edges.
      v: half of the other; the two must not be parallel.

    Returns:
      Points, and which of them are corners. A corner that two edges share is there once.
    """
    area = u[0] * v[1] - u[1] * v[0]
    v, area = jnp.where(area < 0, -v, v), jnp.abs(area)
    corners, edges = jnp.asarray(_CORNERS, half.dtype), jnp.asarray(_EDGES, half.dtype)
    frame = jnp.stack([u, v])
    start, step = centre[None] + corners @ frame, edges @ frame
    t, exists = _entry(start / half[None], step / half[None], open_ended=False)
    points = start + t[:, None] * step

    def local(x):
        a, b = x[:, 0] * v[1] - x[:, 1] * v[0], x[:, 1] * u[0] - x[:, 0] * u[1]
        return jnp.stack([a, b], axis=1) / area

    # An edge of the rectangle on the parallelogram's border would give a corner twice.
    start, step = corners * half[None], edges * half[None]
    t, others = _entry(local(start - centre[None]), local(step), open_ended=True)
    return (
        jnp.concatenate([points, start + t[:, None] * step]),
        jnp.concatenate([exists, others]),
    )


def _entry(start: Float[Array, "n 2"], step: Float[Array, "n 2"], open_ended: bool):
    """Where segments `start + t step`, t in [0, 1], enter the square [-1, 1]^2, and whether.

    A segment that only touches the square does not enter it; one along its border does, unless
    `open_ended` (Liang and Barsky, "A new concept and method for line clipping", 1984).
    """
    eps = 64 * float(jnp.finfo(start.dtype).eps)
    level = jnp.abs(step) <= eps
    safe = jnp.where(level, 1, step)
    middle, reach = -start / safe, 1 / jnp.abs(safe)
    begin = jnp.max(jnp.where(level, 0, middle - reach), axis=1)
    end = jnp.min(jnp.where(level, 1, middle + reach), axis=1)
    begin, end = jnp.clip(begin, 0, 1), jnp.minimum(end, 1)
    between = jnp.max(jnp.abs(start + (begin + end)[:, None] / 2 * step), axis=1)
    inside = between < 1 - eps if open_ended else between <= 1 + eps
    return begin, (end - begin > eps) & inside
