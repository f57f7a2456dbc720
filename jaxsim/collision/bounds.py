"""Lower bounds on the distance of two geoms, from their separation along a few axes.

Two convex shapes with half widths h1 and h2 along a unit axis u, whose centres differ by d, are at
least `|u . d| - h1 - h2` apart (separating axis theorem). The line of centres is a good axis for
round shapes. Boxes need the normals of their faces, because the nearest point of a table is seldom
in the direction of its centre. Against a face, long round shapes need the direction across their
axis. Pairs of spheres and capsules use no further axes: their exact geometry is as cheap.

Vectors are sequences of three numbers and products are written out, so that the bounds of all pairs
are one kernel, which stores only the bound of each pair.
"""

import functools
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.collision.frames import smallest_length
from jaxsim.collision.shapes import Shape
from jaxsim.collision.table import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HFIELD,
    MESH,
    PLANE,
    SDF,
    SPHERE,
)

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
    SDF: _box,
}
# Which columns of a shape's rotation matrix are normals of flat faces.
FACES: dict[int, tuple[int, ...]] = {
    HFIELD: (0, 1, 2),
    CYLINDER: (2,),
    BOX: (0, 1, 2),
    MESH: (0, 1, 2),
}
LONG = CAPSULE, CYLINDER


def distance_bound(types: tuple[int, int], first: Shape, second: Shape) -> Number:
    """Lower bound on the distances of all contacts of two shapes (m).

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
    if types != (BOX, BOX):  # contacts of boxes may have smaller distances than the boxes have
        axes += [_normalized(d)]
    if any(kind in FACES for kind in types):
        axes += [_across(shape.axis, d) for kind, shape in shapes if kind in LONG]
    width = lambda u: HALF_WIDTH[types[0]](first, u) + HALF_WIDTH[types[1]](second, u)  # noqa: E731
    gaps = [jnp.abs(_dot(u, d)) - width(u) for u in axes]
    return functools.reduce(jnp.maximum, gaps)


def _dot(a: Vector, b: Vector) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _across(axis: Vector, d: Vector) -> Vector:
    """Unit vector along the part of d that is orthogonal to a unit axis."""
    along = _dot(axis, d)
    return _normalized([d[k] - along * axis[k] for k in range(3)])


def _normalized(v: list[Number]) -> Vector:
    """A unit vector along v; the x axis if v is too short to have a direction."""
    length = jnp.sqrt(_dot(v, v))
    long = length > smallest_length(length)
    return [jnp.where(long, x / length, f) for x, f in zip(v, np.eye(3)[0], strict=True)]
