"""Shapes of sites as volumes: which points are inside, and which rays hit.

The yes-or-no answers have no derivative.
"""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Bool, Float

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)

# Slower components of a unit direction count as this much, so that they can be divided by.
_MIN_SPEED = 1e-12


def inside(shape: int, size: Float[Array, "3"], p: Float[Array, "3"]) -> Bool[Array, ""]:
    """Whether a point is inside a shape.

    Args:
      shape: a primitive of `mujoco.mjtGeom`, static.
      size: its size as MuJoCo stores it (m).
      p: the point in the shape's frame.
    """
    if shape == _SPHERE:
        return p @ p < size[0] ** 2
    if shape == _CAPSULE:
        beyond = p[2] - jnp.clip(p[2], -size[1], size[1])
        return p[:2] @ p[:2] + beyond**2 < size[0] ** 2
    if shape == _ELLIPSOID:
        return ((p / size) ** 2).sum() < 1
    if shape == _CYLINDER:
        return (jnp.abs(p[2]) < size[1]) & (p[:2] @ p[:2] < size[0] ** 2)
    return (jnp.abs(p) < size).all()


def ray_hits(
    shape: int, size: Float[Array, "3"], p: Float[Array, "3"], d: Float[Array, "3"]
) -> Bool[Array, ""]:
    """Whether the half line `p + t d`, `t >= 0`, meets the volume of a shape.

    Every shape here is an intersection of balls, tubes and slabs, each of which the line is in
    for one interval of `t`, or, a capsule, a union of such.

    Args:
      shape: a primitive of `mujoco.mjtGeom`, static.
      size: its size as MuJoCo stores it (m).
      p: start of the ray in the shape's frame.
      d: its unit direction.
    """
    if shape == _SPHERE:
        return _ahead(_ball(p, d, size[0]))
    if shape == _ELLIPSOID:
        return _ahead(_ball(p / size, d / size, 1.0))
    if shape == _CYLINDER:
        return _ahead(_ball(p[:2], d[:2], size[0]), _slab(p[2], d[2], size[1]))
    if shape == _CAPSULE:
        tip = jnp.zeros_like(p).at[2].set(size[1])
        tube = _ahead(_ball(p[:2], d[:2], size[0]), _slab(p[2], d[2], size[1]))
        return tube | _ahead(_ball(p - tip, d, size[0])) | _ahead(_ball(p + tip, d, size[0]))
    return _ahead(*(_slab(p[k], d[k], size[k]) for k in range(3)))


def _ahead(*intervals):
    """Whether the intersection of intervals `(first, last)` has a point with `t >= 0`."""
    first, last = zip(*intervals, strict=True)
    start, stop = first[0], last[0]
    for a, b in zip(first[1:], last[1:], strict=True):
        start, stop = jnp.maximum(start, a), jnp.minimum(stop, b)
    return (stop >= start) & (stop >= 0)


def _ball(p, d, radius):
    """Interval in which `|p + t d| <= radius`; empty if the line misses. A disc in the plane."""
    a = jnp.maximum(d @ d, _MIN_SPEED**2)
    b, c = p @ d, p @ p - radius**2
    square = b * b - a * c
    root = jnp.sqrt(jnp.where(square > 0, square, 0))
    missed = square < 0
    return jnp.where(missed, 1.0, -b - root) / a, jnp.where(missed, -1.0, -b + root) / a


def _slab(p, d, half):
    """Interval in which `|p + t d| <= half`."""
    d = jnp.where(jnp.abs(d) < _MIN_SPEED, _MIN_SPEED, d)
    t1, t2 = (-half - p) / d, (half - p) / d
    return jnp.minimum(t1, t2), jnp.maximum(t1, t2)
