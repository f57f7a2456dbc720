"""Rays against geoms: closed forms for primitives, triangles of meshes and height fields."""

from jaxsim.collision.rays.cast import RayHit, cast_ray
from jaxsim.collision.rays.visible import opaque_geoms, ray_problems, visible_geoms

__all__ = ["RayHit", "cast_ray", "opaque_geoms", "ray_problems", "visible_geoms"]
