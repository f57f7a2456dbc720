"""Rays against primitives, in the axes of the shape."""

from collections.abc import Callable

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.collision.rays.interval import Crossing, Interval, ball, common, crossing, hull, slab

_Vec = Float[Array, "3"]


def sphere(size: _Vec, p: _Vec, d: _Vec) -> Interval:
    """Interval inside a sphere of radius `size[0]`."""
    return ball(p, d, size[0])


def capsule(size: _Vec, p: _Vec, d: _Vec) -> Interval:
    """Interval inside a capsule of radius `size[0]` and half-length `size[1]`."""
    tip = jnp.zeros_like(p).at[2].set(size[1])
    return hull(cylinder(size, p, d), ball(p - tip, d, size[0]), ball(p + tip, d, size[0]))


def ellipsoid(size: _Vec, p: _Vec, d: _Vec) -> Interval:
    """Interval inside an ellipsoid of semi-axes `size`."""
    return ball(p / size, d / size, 1.0)


def cylinder(size: _Vec, p: _Vec, d: _Vec) -> Interval:
    """Interval inside a cylinder of radius `size[0]` and half-length `size[1]`."""
    return common(ball(p[:2], d[:2], size[0]), slab(p[2], d[2], size[1]))


def box(size: _Vec, p: _Vec, d: _Vec) -> Interval:
    """Interval inside a box of half-lengths `size`."""
    return common(*(slab(p[k], d[k], size[k]) for k in range(3)))


def plane(size: _Vec, p: _Vec, d: _Vec) -> Crossing:
    """Intersection with the front of a plane, of half-lengths `size[:2]` if these are positive."""
    toward = d[2] < -MINVAL
    t = -p[2] / jnp.where(toward, d[2], 1.0)
    at = jnp.abs((p + t * d)[:2])
    hit = toward & (t >= 0) & ((size[:2] <= 0) | (at <= size[:2])).all()
    return jnp.where(hit, t, jnp.inf), jnp.zeros_like(hit)


_Geom = mujoco.mjtGeom
# Intervals `f(size, p, d)` of convex shapes by `mujoco.mjtGeom`.
INTERVALS: dict[int, Callable[[_Vec, _Vec, _Vec], Interval]] = {
    int(_Geom.mjGEOM_SPHERE): sphere,
    int(_Geom.mjGEOM_CAPSULE): capsule,
    int(_Geom.mjGEOM_ELLIPSOID): ellipsoid,
    int(_Geom.mjGEOM_CYLINDER): cylinder,
    int(_Geom.mjGEOM_BOX): box,
}


def primitive(kind: int, size: _Vec, p: _Vec, d: _Vec) -> Crossing:
    """Intersection of a ray with a plane or a convex primitive."""
    if kind == int(_Geom.mjGEOM_PLANE):
        return plane(size, p, d)
    return crossing(INTERVALS[kind](size, p, d))
