"""Four corners of the intersection of two convex polygons, where it has more.

MuJoCo clips one polygon by the lines of the other, and then moves three corners of a quadrilateral
forward while its area grows; its first corner is the first of the clipped polygon. Which corner
that is, and with it the result, depends on the order of the clipping. This does the same with the
corners' numbers. It has no derivatives.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int


def widest_four(
    points: Float[Array, "n 2"], exists: Bool[Array, "n"], order: Int[Array, "n"]
) -> Int[Array, "4"]:
    """Numbers of four corners of a large quadrilateral.

    Args:
      points: corners of a convex polygon, in any order.
      exists: whether each counts.
      order: numbers of corners around the polygon, -1 at the end.
    """
    kept = exists[order] & (order >= 0)
    order = order[jnp.argsort(~kept, stable=True)]
    corner, count = points[order], jnp.sum(kept)

    def area(b, c, d):
        x, y = corner[c] - corner[0], corner[d] - corner[b]
        return jnp.abs(x[0] * y[1] - x[1] * y[0])

    def advance(state):
        # The third of the moving corners goes first, then the second, then the first.
        at, largest, turn, _, tries = state
        moved = jnp.where(jnp.arange(3) == 2 - turn, (at + 1) % count, at)
        size = area(*moved)
        larger = size > largest
        following = jnp.where(larger, jnp.where(turn == 0, 1, turn), (turn + 1) % 3)
        at = jnp.where(larger, moved, at)
        ends = (turn == 0) & ~larger
        return at, jnp.where(larger, size, largest), following, ends, tries + 1

    # Each of the three goes around once at most, and the other two fail once after each step of the
    # third. Of a polygon without area, rounding may let them go around for ever.
    most = 8 * len(points)
    start, zero = jnp.arange(1, 4), jnp.zeros((), int)
    state = start, area(*start), zero, count <= 4, zero
    at = lax.while_loop(lambda s: ~s[3] & (s[4] < most), advance, state)[0]
    return jnp.concatenate([order[:1], order[at]])


@struct.dataclass
class Clipped:
    """The intersection of two polygons as the algorithm of Sutherland and Hodgman (1974) leaves it.

    Corners are numbered as by `overlap_corners(subject, window[::-1], ...)`: by the edge that
    starts there.

    Attributes:
      order: numbers of the corners around it, padded by -1.
      height: height of each corner by its number, 0 of others.
    """

    order: Int[Array, "n"]
    height: Float[Array, "n"]


def clipped(
    subject: Float[Array, "m 3"],
    corners: Int[Array, ""] | int,
    window: Float[Array, "k 2"],
    small: Float[Array, ""],
) -> Clipped:
    """Clip one polygon by the lines of another, seen from above.

    The corners of a polygon that is not quite flat have heights of their own, and a cut is at the
    height of the edge that is cut, which may be due to an earlier cut.

    Args:
      subject: a convex polygon, counterclockwise; its last corner is repeated as padding. The third
        coordinate is the height.
      corners: number of its different corners.
      window: a convex polygon, clockwise, padded in the same way.
      small: points outside by less than this length are inside.
    """
    m, k = len(subject), len(window)
    slot = jnp.arange(m + k, dtype=jnp.int32)
    edge = jnp.where(slot == corners - 1, m - 1, slot)
    point = jnp.concatenate([subject, jnp.zeros((k, 3), subject.dtype)])

    def clip(state, line):
        start, end, number = line
        new = _clip(state, start, end, number, small)
        side = end - start
        return jax.tree.map(lambda x, y: jnp.where(side @ side > small**2, x, y), new, state), None

    number = (m + (k - 2 - jnp.arange(k)) % k).astype(jnp.int32)
    state = point, edge, jnp.asarray(corners, jnp.int32)
    point, edge, count = lax.scan(clip, state, (window, jnp.roll(window, -1, axis=0), number))[0]
    order = jnp.where(slot < count, edge, -1)
    height = jnp.sum(jnp.where(order[None] == slot[:, None], point[:, 2], 0), axis=1)
    return Clipped(order, height)


def _clip(state, start, end, number, small):
    """The polygon's part on the right of a line; corners are points and the edges from them."""
    point, edge, count = state
    slot = jnp.arange(len(point), dtype=jnp.int32)
    side = end - start
    rightward = jnp.stack([side[1], -side[0]]) / jnp.sqrt(jnp.maximum(side @ side, small**2))
    height = (point[:, :2] - start[None]) @ rightward
    inside = height > -small
    following = jnp.where(slot + 1 < count, slot + 1, 0)
    enters = inside[following] & (slot < count)
    crosses = (inside ^ inside[following]) & (slot < count)
    fall = height - height[following]
    crossing = height / jnp.where(crosses & (fall != 0), fall, 1)
    between = point + crossing[:, None] * (point[following] - point)
    # Each edge leaves the point where it crosses the line, then its end if that is inside.
    number_left = crosses.astype(jnp.int32) + enters
    last = jnp.cumsum(number_left, dtype=jnp.int32)
    source = jnp.minimum(jnp.sum(last[None] <= slot[:, None], axis=1), len(point) - 1)
    is_crossing = crosses[source] & (slot == (last - number_left)[source])
    new = jnp.where(is_crossing[:, None], between[source], point[following[source]])
    after = jnp.where(inside, number, edge)[source]
    after = jnp.where(is_crossing, after, edge[following[source]])
    return new, after, jnp.minimum(last[-1], len(point))
