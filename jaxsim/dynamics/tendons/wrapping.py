"""Tendons that wrap around spheres and cylinders or pass through them.

Both problems reduce to a path around a circle in a plane. For a sphere it is the plane through both
points and the centre. For a cylinder it is the plane across its axis, and the path advances along
the axis at a constant slope. Sites near the centre, side sites, and side sites inside the surface
follow MuJoCo's rules.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.norms import norm_and_divisor, safe_norm
from jaxsim.dynamics.tendons.circle import Arc, around, through


class Wrap(NamedTuple):
    """The part of a tendon on a surface.

    Attributes:
      touches: whether the tendon touches the surface; if not, the other fields have no meaning.
      start: point where it meets the surface (m).
      stop: point where it leaves the surface (m).
      length: length of the path between them (m).
    """

    touches: Bool[Array, ""]
    start: Float[Array, "3"]
    stop: Float[Array, "3"]
    length: Float[Array, ""]


def wrap_sphere(
    x0: Float[Array, "3"],
    x1: Float[Array, "3"],
    pos: Float[Array, "3"],
    mat: Float[Array, "3 3"],
    radius: Float[Array, ""],
    side: Float[Array, "3"] | None = None,
) -> Wrap:
    """Wrap a tendon segment from x0 to x1 around a sphere, or pass it through the sphere.

    Args:
      x0: first point of the segment, world coordinates (m).
      x1: last point of the segment (m).
      pos: centre of the sphere (m).
      mat: orientation of the sphere.
      radius: radius of the sphere (m).
      side: position of the side site (m); inside the sphere, it makes the tendon pass through.
    """
    p0, p1 = (x0 - pos) @ mat, (x1 - pos) @ mat
    apart = (p0 @ p0 >= MINVAL**2) & (p1 @ p1 >= MINVAL**2)
    p0 = jnp.where(apart, p0, np.eye(3, dtype=p0.dtype)[0])
    p1 = jnp.where(apart, p1, np.eye(3, dtype=p0.dtype)[1])
    axes = _plane(p0, p1)
    arc = _arc(axes @ p0, axes @ p1, radius, _in_frame(pos, mat, side), axes)
    start, stop = (pos + mat @ (q @ axes) for q in (arc.start, arc.stop))
    return Wrap(arc.touches & apart, start, stop, arc.length)


def wrap_cylinder(
    x0: Float[Array, "3"],
    x1: Float[Array, "3"],
    pos: Float[Array, "3"],
    mat: Float[Array, "3 3"],
    radius: Float[Array, ""],
    side: Float[Array, "3"] | None = None,
) -> Wrap:
    """Wrap a tendon segment around an infinite cylinder; arguments as for `wrap_sphere`."""
    p0, p1 = (x0 - pos) @ mat, (x1 - pos) @ mat
    apart = (p0 @ p0 >= MINVAL**2) & (p1 @ p1 >= MINVAL**2)
    flat = np.eye(3, dtype=p0.dtype)[:2]
    arc = _arc(p0[:2], p1[:2], radius, _in_frame(pos, mat, side), flat)
    before, after = safe_norm(p0[:2] - arc.start), safe_norm(p1[:2] - arc.stop)
    total = before + arc.length + after
    slope = (p1[2] - p0[2]) / jnp.where(total > 0, total, 1.0)
    start = jnp.append(arc.start, p0[2] + slope * before)
    stop = jnp.append(arc.stop, p0[2] + slope * (before + arc.length))
    length = safe_norm(jnp.stack([arc.length, slope * arc.length]))
    return Wrap(arc.touches & apart, pos + mat @ start, pos + mat @ stop, length)


def _in_frame(pos, mat, side):
    """The side site, if there is one, in the frame of the surface."""
    return None if side is None else (side - pos) @ mat


def _arc(p0, p1, radius, side, axes) -> Arc:
    """The path in the plane spanned by `axes`; `side` is a point in space."""
    if side is None:
        return around(p0, p1, radius, None)
    direction = axes @ side
    direction = jnp.where(safe_norm(direction) < MINVAL, np.eye(2, dtype=p0.dtype)[0], direction)
    outer, inner = around(p0, p1, radius, direction), through(p0, p1, radius)
    inside = side @ side < radius**2
    return Arc(*(jnp.where(inside, a, b) for a, b in zip(inner, outer, strict=True)))


def _plane(p0, p1) -> Float[Array, "2 3"]:
    """Two perpendicular directions in the plane of both points and the origin, the first to p0.

    If they are on one line, the plane is chosen as in MuJoCo, by the largest component of p0.
    """
    first = p0 / norm_and_divisor(p0)[1]
    normal = jnp.cross(p0, p1)
    other = jnp.where(jnp.arange(3) == jnp.argmax(jnp.abs(first)), 0.0, 1.0).astype(p0.dtype)
    on_a_line = normal @ normal < MINVAL**2
    normal = jnp.where(on_a_line, jnp.cross(first, other), normal)
    second = jnp.cross(normal, first)
    return jnp.stack([first, second / norm_and_divisor(second)[1]])
