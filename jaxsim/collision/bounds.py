"""A cheap lower bound on the distance of two geoms: how far they are apart along a few axes.

Convex shapes whose centres are apart by d and whose half widths along a unit axis u are h1 and h2
are at least `|u . d| - h1 - h2` apart (the separating axis theorem). The direction of the centres
suits round shapes. Large boxes need the normals of their faces: the nearest point of a table is
seldom in the direction of its centre. Beside a face, long round shapes need the directions across
them; for pairs of spheres and capsules the exact geometry is hardly dearer than more axes.

Vectors are sequences of three numbers and products are written out. For all pairs of many shapes
that is one kernel, which stores nothing for each pair but its bound.
"""

import functools
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.collision.frames import smallest_length
from jaxsim.collision.shapes import Shape
from jaxsim.collision.table import BOX, CAPSULE, CYLINDER, ELLIPSOID, HFIELD, MESH, PLANE, SPHERE

Number = Float[Array, ""]
Vector = Sequence[Number] | Float[Array, "3"]


def _capsule(shape: Shape, u: Vector) -> Number:
    return shape.size[0] + shape.size[1] * jnp.abs(_dot(shape.axis, u))


def _ellipsoid(shape: Shape, u: Vector) -> Number:
    scaled = [shape.size[k] * _dot(shape.mat[:, k], u) for k in range(3)]
    return jnp.sqrt(_dot(scaled, scaled))


def _cylinder(shape: Shape, u: Vector) -> Number:
    across = jnp.sqrt(_dot(shape.mat[:, 0], u) ** 2 + _dot(shape.mat[:, 1], u) ** 2)
    return shape.size[0] * across + shape.size[1] * jnp.abs(_dot(shape.axis, u))


def _box(shape: Shape, u: Vector) -> Number:
    return _dot(shape.size, [jnp.abs(_dot(shape.mat[:, k], u)) for k in range(3)])


def _height_field(shape: Shape, u: Vector) -> Number:
    # Its third size is a quarter of its height above the origin plus half of its depth below.
    return _dot(
        [shape.size[0], shape.size[1], 4 * shape.size[2]],
        [jnp.abs(_dot(shape.mat[:, k], u)) for k in range(3)],
    )


# Half the width of a shape, which is symmetric about its centre, along a unit axis.
HALF_WIDTH: dict[int, Callable[[Shape, Vector], Number]] = {
    HFIELD: _height_field,
    SPHERE: lambda shape, u: shape.size[0],
    CAPSULE: _capsule,
    ELLIPSOID: _ellipsoid,
    CYLINDER: _cylinder,
    BOX: _box,
    MESH: _box,
}
# Columns of a shape's rotation that are normals of flat faces.
FACES: dict[int, tuple[int, ...]] = {
    HFIELD: (0, 1, 2),
    CYLINDER: (2,),
    BOX: (0, 1, 2),
}
LONG = CAPSULE, CYLINDER


def distance_bound(types: tuple[int, int], first: Shape, second: Shape) -> Number:
    """A number that no contact of the two shapes can have a smaller distance than.

    Args:
      types: types of the shapes, the lower number first.
      first: first shape; if it is a plane, the bound is the distance itself.
      second: second shape.
    """
    d = [second.pos[k] - first.pos[k] for k in range(3)]
    if types[0] == PLANE:
        return _dot(first.axis, d) - HALF_WIDTH[types[1]](second, first.axis)
    shapes = tuple(zip(types, (first, second), strict=True))
    axes = [shape.mat[:, k] for kind, shape in shapes for k in FACES.get(kind, ())]
    if types != (BOX, BOX):  # whose contacts, along normals, may be closer than their distance
        axes += [_normalized(d)]
    if any(kind in FACES for kind in types):
        axes += [_across(shape.axis, d) for kind, shape in shapes if kind in LONG]
    width = lambda u: HALF_WIDTH[types[0]](first, u) + HALF_WIDTH[types[1]](second, u)  # noqa: E731
    gaps = [jnp.abs(_dot(u, d)) - width(u) for u in axes]
    return functools.reduce(jnp.maximum, gaps)


def _dot(a: Vector, b: Vector) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _across(axis: Vector, d: Vector) -> Vector:
    """The direction of d without its part along a unit axis."""
    along = _dot(axis, d)
    return _normalized([d[k] - along * axis[k] for k in range(3)])


def _normalized(v: list[Number]) -> Vector:
    """A unit vector along v; any, if v is too short to have a direction."""
    length = jnp.sqrt(_dot(v, v))
    long = length > smallest_length(length)
    return [jnp.where(long, x / length, f) for x, f in zip(v, np.eye(3)[0], strict=True)]
