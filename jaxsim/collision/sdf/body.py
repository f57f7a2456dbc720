"""Signed distances of points to shapes, in the shapes' own axes, and boxes that contain them.

Outside of meshes the distance is a lower bound: the height above the plane of a face.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.collision.shapes import Shape

# Steps of Newton's method for the distance to an ellipsoid.
_NEWTON = 12

Point = Float[Array, "3"]
Half = Float[Array, "3"]


class Body(NamedTuple):
    """A kind of shape.

    Attributes:
      distance: from a shape and a point to the signed distance (m).
      half: from a shape to the half-lengths of a box around it (m); None if it is unbounded.
      nearest: from a shape and a point to its nearest point of the shape; None where that follows
        from the distance.
    """

    distance: Callable[[Shape, Point], Float[Array, ""]]
    half: Callable[[Shape], Half] | None
    nearest: Callable[[Shape, Point], Point] | None = None


def _plane(shape: Shape, x: Point) -> Float[Array, ""]:
    """Height above a plane."""
    return x[2]


def _sphere(shape: Shape, x: Point) -> Float[Array, ""]:
    """Distance to a sphere."""
    return _length(x) - shape.size[0]


def _capsule(shape: Shape, x: Point) -> Float[Array, ""]:
    """Distance to a capsule along the third axis."""
    z = x[2] - jnp.clip(x[2], -shape.size[1], shape.size[1])
    return _length(jnp.stack([x[0], x[1], z])) - shape.size[0]


def _ellipsoid(shape: Shape, x: Point) -> Float[Array, ""]:
    """Distance to an ellipsoid with semi-axes s.

    The nearest point is `s^2 x / (t + s^2)` with the largest root t of `|s x / (t + s^2)| = 1`. The
    square of that, minus one, is convex and positive at the start, so that Newton's method cannot
    fail. Derivatives go through its last two steps, so that second ones are exact.
    """
    square = shape.size**2

    def newton(_, t, x=x, square=square):
        below = t + square
        terms = square * (x / below) ** 2
        slope = -2 * jnp.sum(terms / below)
        return t - (jnp.sum(terms) - 1) / jnp.where(slope < 0, slope, -1.0)

    fixed = lax.stop_gradient((x, square))
    start = jnp.max(shape.size * jnp.abs(x) - square)
    held = functools.partial(newton, x=fixed[0], square=fixed[1])
    t = lax.fori_loop(0, _NEWTON, held, lax.stop_gradient(start))
    t = newton(1, newton(0, lax.stop_gradient(t)))
    return t * _length(x / (t + square))


def _cylinder(shape: Shape, x: Point) -> Float[Array, ""]:
    """Distance to a cylinder along the third axis."""
    out = jnp.stack([_length(x[:2]) - shape.size[0], jnp.abs(x[2]) - shape.size[1]])
    return _outside(out)


def _box(shape: Shape, x: Point) -> Float[Array, ""]:
    """Distance to a box."""
    return _outside(jnp.abs(x) - shape.size)


def _mesh(shape: Shape, x: Point) -> Float[Array, ""]:
    """Largest height above the planes of the faces of a hull."""
    normal, offset = _faces(shape)
    return jnp.max(normal @ x - offset)


def _nearest_of_mesh(shape: Shape, x: Point) -> Point:
    """The nearest point of a hull: on the plane that x is furthest above.

    If that is outside, it is on the edge with the plane that it is furthest above, and then at a
    corner.
    """
    normal, offset = _faces(shape)
    axes: list[Array] = []
    for _ in range(3):
        height = normal @ x - offset
        index = jnp.argmax(height)
        n = normal[index]
        along = functools.reduce(lambda v, axis: v - (v @ axis) * axis, axes, n)
        square = along @ along
        outside = (height[index] > 0) & (square > 1e-6)
        along = jnp.where(outside, along, n)
        x = x - jnp.where(outside, height[index], 0.0) / (along @ n) * along
        axes.append(jnp.where(outside, 1.0, 0.0) * along / jnp.sqrt(along @ along))
    return x


def _faces(shape: Shape) -> tuple[Float[Array, "f 3"], Float[Array, "f"]]:
    """Outward unit normals of the faces of a hull, and the distances of their planes (m)."""
    hull = shape.hull
    if hull is None or hull.faces is None:
        raise ValueError("the shape of a mesh needs a hull")
    normal = hull.faces.normal[hull.row] / shape.size[None]
    length = jnp.sqrt(jnp.sum(normal * normal, axis=1))
    return normal / length[:, None], hull.faces.offset[hull.row] / length


def _signed_distance(shape: Shape, x: Point) -> Float[Array, ""]:
    """Distance by the user's function."""
    if shape.sdf is None:
        raise ValueError("the shape needs its signed distance function")
    return shape.sdf(x)


def _length(v: Float[Array, "k"]) -> Float[Array, ""]:
    return norm_and_divisor(v)[0]


def _outside(out: Float[Array, "k"]) -> Float[Array, ""]:
    """Distance from how far a point is beyond orthogonal faces."""
    return _length(jnp.maximum(out, 0.0)) + jnp.minimum(jnp.max(out), 0.0)


def _round(shape: Shape) -> Half:
    """Half-lengths of the box of a cylinder."""
    return jnp.stack([shape.size[0], shape.size[0], shape.size[1]])


plane = Body(_plane, None)
sphere = Body(_sphere, lambda shape: jnp.broadcast_to(shape.size[0], 3))
capsule = Body(_capsule, lambda shape: _round(shape).at[2].add(shape.size[0]))
ellipsoid = Body(_ellipsoid, lambda shape: shape.size)
cylinder = Body(_cylinder, _round)
box = Body(_box, lambda shape: shape.size)
mesh = Body(_mesh, lambda shape: shape.size, _nearest_of_mesh)
signed_distance = Body(_signed_distance, lambda shape: shape.size)
