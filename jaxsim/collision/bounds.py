"""A cheap lower bound on the distance of two geoms, from bounding spheres."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.collision.shapes import Shape
from jaxsim.collision.table import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SPHERE

# Radius of the smallest ball around a shape's centre that contains it, from its size.
BOUNDING_RADIUS: dict[int, Callable[[Float[Array, "3"]], Float[Array, ""]]] = {
    SPHERE: lambda size: size[0],
    CAPSULE: lambda size: size[0] + size[1],
    ELLIPSOID: jnp.max,
    CYLINDER: lambda size: jnp.sqrt(size[0] ** 2 + size[1] ** 2),
    BOX: lambda size: jnp.sqrt(size @ size),
}


def distance_bound(types: tuple[int, int], first: Shape, second: Shape) -> Float[Array, ""]:
    """A number that no contact of the two shapes can have a smaller distance than.

    Args:
      types: types of the shapes, the lower number first.
      first: first shape; a plane is bounded by itself.
      second: second shape.
    """
    between = second.pos - first.pos
    radius = BOUNDING_RADIUS[types[1]](second.size)
    if types[0] == PLANE:
        return first.axis @ between - radius
    return jnp.sqrt(between @ between) - BOUNDING_RADIUS[types[0]](first.size) - radius
