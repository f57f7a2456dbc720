"""Volumes of sites: tests whether points are inside, and whether rays hit them."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Bool, Float

from jaxsim.collision.rays.interval import meets
from jaxsim.collision.rays.primitives import INTERVALS

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)


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
    """Whether the ray `p + t d`, `t >= 0`, hits the volume of a shape.

    Args:
      shape: a primitive of `mujoco.mjtGeom`, static.
      size: its size as MuJoCo stores it (m).
      p: start of the ray in the shape's frame.
      d: unit direction of the ray.
    """
    return meets(INTERVALS[shape](size, p, d))
