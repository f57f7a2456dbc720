"""Shortest paths in the plane around a circle about the origin, or through it.

A path around the circle has two straight tangent parts and an arc between them, as a cord on a
pulley. MuJoCo's rule decides whether it touches the circle (Computation, section Spatial tendons);
where it does not, the results are finite but without meaning. A path through the circle, as of a
cord in a ring, touches it in one point.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.norms import norm_and_divisor

# Newton's method for the angle of a path through a circle converges monotonically. These steps
# reach float64 accuracy unless the path is within 1e-8 of being tangent to the circle.
_NEWTON_STEPS = 12


class Arc(NamedTuple):
    """The part of a path on the circle.

    Attributes:
      touches: whether the path touches the circle; if not, it is a straight line.
      start: point where the path meets the circle (m).
      stop: point where it leaves the circle (m).
      length: length of the arc between them (m).
    """

    touches: Bool[Array, ""]
    start: Float[Array, "2"]
    stop: Float[Array, "2"]
    length: Float[Array, ""]


def around(
    p0: Float[Array, "2"],
    p1: Float[Array, "2"],
    radius: Float[Array, ""],
    side: Float[Array, "2"] | None,
) -> Arc:
    """The path around the circle.

    Args:
      p0: first point of the path (m).
      p1: last point of the path (m).
      radius: radius of the circle (m).
      side: direction from the centre to the side on which the path passes; None for the shorter
        path.
    """
    gap = p1 - p0
    nearest = _nearest(p0, gap)
    meets = nearest @ nearest <= radius**2
    if side is not None:
        meets = meets | (side @ nearest < 0)
    possible = meets & (gap @ gap >= MINVAL) & _outside(p0, p1, radius)
    p0, p1, radius = _or_default(possible, p0, p1, radius)
    ways = [_tangents(p0, p1, radius, turn) for turn in (-1.0, 1.0)]
    cross = [_segments_meet(p0, start, p1, stop) for start, stop in ways]
    merit = [jnp.where(x, -1e4, _merit(*way, side)) for way, x in zip(ways, cross, strict=True)]
    clockwise = merit[0] > merit[1]
    start, stop = (jnp.where(clockwise, a, b) for a, b in zip(*ways, strict=True))
    angle = _angle(start, stop, jnp.where(clockwise, -1.0, 1.0))
    return Arc(possible & ~jnp.where(clockwise, *cross), start, stop, radius * angle)


def through(p0: Float[Array, "2"], p1: Float[Array, "2"], radius: Float[Array, ""]) -> Arc:
    """The path through the circle; it is straight if the line from p0 to p1 meets the circle.

    Both straight parts have the same angle a to the normal at the point where they touch the
    circle. Seen from the centre, the angle between this point and p0, at the distance l0, is
    `a - asin(r sin(a) / l0)`, and likewise for p1. The sum of these two angles is the angle between
    p0 and p1, an equation for a.
    """
    nearest = _nearest(p0, p1 - p0)
    possible = (nearest @ nearest > radius**2) & _outside(p0, p1, radius)
    p0, p1, radius = _or_default(possible, p0, p1, radius)
    signed = jnp.arctan2(_cross(p0, p1), p0 @ p1)
    turn = jnp.where(signed < 0, -1.0, 1.0)
    # Less than one, so that the arc sines have finite derivatives.
    largest = 1 - jnp.finfo(radius.dtype).eps
    ratio = [jnp.minimum(radius / jnp.sqrt(p @ p), largest) for p in (p0, p1)]
    incidence = _incidence(ratio[0], ratio[1], turn * signed)
    angle = turn * (incidence - jnp.arcsin(ratio[0] * jnp.sin(incidence)))
    point = ratio[0] * (jnp.cos(angle) * p0 + jnp.sin(angle) * jnp.stack([-p0[1], p0[0]]))
    return Arc(possible, point, point, jnp.zeros_like(radius))


def _incidence(ratio0, ratio1, between) -> Float[Array, ""]:
    """The angle a with `asin(ratio0 sin a) + asin(ratio1 sin a) - 2 a + between = 0`.

    The left side is decreasing and concave, and not positive at a = pi / 2, so Newton's method from
    there converges monotonically. Its last two steps are differentiated: one gives the solution's
    first derivative, two give its second derivative.
    """

    def newton(a, ratio0, ratio1, between):
        sines = [ratio * jnp.sin(a) for ratio in (ratio0, ratio1)]
        value = sum(jnp.arcsin(s) for s in sines) - 2 * a + between
        slopes = (
            ratio * jnp.cos(a) / jnp.sqrt(1 - s * s)
            for ratio, s in zip((ratio0, ratio1), sines, strict=True)
        )
        return a - value / (sum(slopes) - 2)

    known = jax.lax.stop_gradient((ratio0, ratio1, between))
    a = jnp.full_like(between, np.pi / 2)
    a = jax.lax.fori_loop(0, _NEWTON_STEPS, lambda _, a: newton(a, *known), a)
    a = jax.lax.stop_gradient(a)
    for _ in range(2):
        a = newton(a, ratio0, ratio1, between)
    return a


def _tangents(p0, p1, radius, turn):
    """Tangent points from p0 and p1, for a path that goes around in the direction `turn`."""
    return _tangent(p0, radius, -turn), _tangent(p1, radius, turn)


def _tangent(p, radius, turn):
    """Tangent point of one of the two tangents through p, selected by the sign `turn`."""
    square = p @ p
    beyond = square - radius**2
    height = jnp.where(beyond > 0, jnp.sqrt(jnp.where(beyond > 0, beyond, 1.0)), 0.0)
    return (radius**2 * p + turn * radius * height * jnp.stack([p[1], -p[0]])) / square


def _angle(start, stop, turn):
    """Angle from `start` to `stop` in the direction `turn`, from 0 to 2 pi."""
    angle = jnp.arctan2(turn * _cross(start, stop), start @ stop)
    return jnp.where(angle < 0, angle + 2 * np.pi, angle)


def _merit(start, stop, side):
    """A number by which paths are compared: higher if shorter, or further on the given side."""
    if side is None:
        return -(start - stop) @ (start - stop)
    middle = start + stop
    return middle @ side / norm_and_divisor(middle)[1]


def _nearest(p, gap):
    """The point of the segment from p to `p + gap` that is nearest to the origin."""
    along = -(p @ gap) / jnp.maximum(gap @ gap, MINVAL)
    return p + jnp.clip(along, 0, 1) * gap


def _segments_meet(a0, a1, b0, b1) -> Bool[Array, ""]:
    """Whether the segments from a0 to a1 and from b0 to b1 have a common point."""
    a, b, apart = a1 - a0, b1 - b0, a0 - b0
    determinant = _cross(a, b)
    known = jnp.abs(determinant) >= MINVAL
    divisor = jnp.where(known, determinant, 1.0)
    on_a, on_b = _cross(b, apart) / divisor, _cross(a, apart) / divisor
    return known & (on_a >= 0) & (on_a <= 1) & (on_b >= 0) & (on_b <= 1)


def _outside(p0, p1, radius) -> Bool[Array, ""]:
    """Whether the radius is positive and both points are outside the circle."""
    return (p0 @ p0 >= radius**2) & (p1 @ p1 >= radius**2) & (radius >= MINVAL)


def _or_default(possible, p0, p1, radius):
    """The points and the radius where `possible`, else some for which all formulas are finite."""
    one, two = np.array([2.0, 0.0]), np.array([0.0, 2.0])
    return (
        jnp.where(possible, p0, one.astype(p0.dtype)),
        jnp.where(possible, p1, two.astype(p1.dtype)),
        jnp.where(possible, radius, 1.0),
    )


def _cross(a, b):
    """The third component of the cross product."""
    return a[0] * b[1] - a[1] * b[0]
