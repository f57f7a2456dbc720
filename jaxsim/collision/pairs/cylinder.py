"""A sphere against a cylinder."""

import jax.numpy as jnp

from jaxsim.collision.frames import direction, tangent_of, unit
from jaxsim.collision.shapes import Contacts, Shape


def sphere_cylinder(sphere: Shape, cylinder: Shape) -> Contacts:
    """One contact, with the side, a cap or a rim; from inside, with the closer of side and cap.

    In the plane of the axis and the sphere's centre the cylinder is a rectangle: with the distance
    rho from the axis and the height x, the excesses are `e = (rho - radius, |x| - half-length)`.
    """
    local = cylinder.mat.T @ (sphere.pos - cylinder.pos)
    fallback, _ = direction(jnp.cross(sphere.axis, cylinder.axis), unit(0, local))
    across = local * jnp.array([1, 1, 0], local.dtype)
    radial, rho = direction(across, -cylinder.mat.T @ fallback)
    upward = jnp.where(local[2] > 0, 1, -1) * unit(2, local)
    excess = jnp.stack([rho - cylinder.size[0], jnp.abs(local[2]) - cylinder.size[1]])
    outside = jnp.maximum(excess, 0)
    corner = (excess[0] >= 0) & (excess[1] >= 0)
    side = ~corner & ((excess[0] >= 0) | ((excess[1] < 0) & (excess[0] >= excess[1])))
    outward, length = direction(radial * outside[0] + upward * outside[1], upward)
    outward = jnp.where(corner, outward, jnp.where(side, radial, upward))
    length = jnp.where(corner, length, jnp.where(side, excess[0], excess[1]))
    dist, normal = length - sphere.size[0], -cylinder.mat @ outward
    pos = sphere.pos + normal * (sphere.size[0] + dist / 2)
    return Contacts(dist[None], pos[None], normal[None], tangent_of(normal)[None])
