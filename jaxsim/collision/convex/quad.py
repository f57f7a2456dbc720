"""Four corners of the intersection of two convex polygons, where it has more.

MuJoCo clips one polygon by the lines of the other. Then the first corner of a quadrilateral goes
once around the clipped polygon, and the other three go forward while the area grows. Where that
ends depends on the order of the clipping. This does the same with the corners' numbers. It has no
derivatives.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int


def widest_four(points: Float[Array, "n 3"], exists: Bool[Array, "n"]) -> Int[Array, "4"]:
    """Numbers of four corners of a large quadrilateral.

    Args:
      points: corners of a convex polygon, in order.
      exists: whether each counts.
    """
    order = jnp.argsort(~exists, stable=True)
    corner, count = points[order], jnp.sum(exists)

    def area(at):
        a, b, c, d = corner[at]
        twice = jnp.cross(c - a, d - b)
        return jnp.sqrt(twice @ twice)

    def advance(state):
        # The last corner goes first, then the third, then the second.
        at, widest, largest, turn, tries = state
        moved = jnp.where(jnp.arange(4) == 3 - turn, (at + 1) % count, at)
        size = area(moved)
        larger = size > largest
        at, widest = jnp.where(larger, moved, at), jnp.where(larger, moved, widest)
        ends = (turn == 0) & ~larger
        turn = jnp.where(larger, jnp.maximum(turn, 1), (turn + 1) % 3)
        at = jnp.where(ends, _from_next(at, count), at)
        return at, widest, jnp.maximum(size, largest), jnp.where(ends, 0, turn), tries + 1

    # The first corner goes around once and the others not much further, and some tries fail after
    # each step. Of a polygon without area, rounding may let them go around for ever.
    most = 16 * len(points)
    start, zero = jnp.arange(4), jnp.zeros((), int)
    state = start, start, area(start), zero, zero
    going = lambda s: (s[0][0] < count) & (count > 4) & (s[4] < most)  # noqa: E731
    return order[lax.while_loop(going, advance, state)[1]]


def _from_next(at: Int[Array, "4"], count: Int[Array, ""]) -> Int[Array, "4"]:
    """The corners when the first is the next one; the others stay, but not behind the first."""
    a, b, c, d = at
    passed = b == a
    b = jnp.where(passed, (b + 1) % count, b)
    passed = passed & (c == b)
    c = jnp.where(passed, (c + 1) % count, c)
    passed = passed & (d == c)
    d = jnp.where(passed, (d + 1) % count, d)
    return jnp.stack([a + 1, b, c, d])


def clipped(
    subject: Float[Array, "m 3"],
    corners: Int[Array, ""] | int,
    window: Float[Array, "k 2"],
    small: Float[Array, ""],
) -> tuple[Float[Array, "m+k 3"], Int[Array, "m+k"]]:
    """Clip a polygon by the lines of another (Sutherland and Hodgman, 1974), seen from above.

    The corners of a polygon that is not quite flat have heights of their own, and a cut is at the
    height of the edge that is cut, which may be due to an earlier cut.

    Args:
      subject: a convex polygon, counterclockwise; its last corner is repeated as padding. The first
        coordinate is the height.
      corners: number of its different corners.
      window: a convex polygon, clockwise, padded in the same way.
      small: points outside by less than this length are inside.

    Returns:
      The corners of the intersection in order, and their numbers, which are -1 where there are no
      more. Corners are numbered as by `overlap_corners(subject, window[::-1], ...)`: by the edge
      that starts there.
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
    return point, jnp.where(slot < count, edge, -1)


def _clip(state, start, end, number, small):
    """The polygon's part on the right of a line; corners are points and the edges from them."""
    point, edge, count = state
    slot = jnp.arange(len(point), dtype=jnp.int32)
    side = end - start
    rightward = jnp.stack([side[1], -side[0]]) / jnp.sqrt(jnp.maximum(side @ side, small**2))
    height = (point[:, 1:] - start[None]) @ rightward
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
