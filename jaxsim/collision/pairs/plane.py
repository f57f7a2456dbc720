"""An infinite plane against a sphere, capsule, ellipsoid, cylinder, box or mesh.

The normal n is the plane's third axis and points away from the solid half-space. A point x of the
other shape has the distance n . (x - p), where p is any point of the plane, and its contact is
half-way between x and the plane. The points x are those that MuJoCo chooses
(`engine_collision_primitive.c`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxsim.collision.convex import Polytope
from jaxsim.collision.frames import direction, tangent_along, tangent_of, unit
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape


def plane_sphere(plane: Shape, sphere: Shape) -> Contacts:
    """One contact, at the sphere's lowest point."""
    lowest = sphere.pos - plane.axis * sphere.size[0]
    return _at_points(plane, lowest[None], tangent_of(plane.axis))


def plane_capsule(plane: Shape, capsule: Shape) -> Contacts:
    """Two contacts, one for each end's sphere; the first tangent is along the capsule's axis."""
    half = capsule.axis * capsule.size[1]
    lowest = capsule.pos - plane.axis * capsule.size[0]
    points = jnp.stack([lowest + half, lowest - half])
    return _at_points(plane, points, tangent_along(capsule.axis, plane.axis))


def plane_ellipsoid(plane: Shape, ellipsoid: Shape) -> Contacts:
    """One contact, at the support point: with S = diag(size), x = -S S m / |S m|, m = R^T n."""
    scaled = ellipsoid.size * (ellipsoid.mat.T @ plane.axis)
    lowest = -ellipsoid.size * scaled / jnp.sqrt(scaled @ scaled)
    point = ellipsoid.pos + ellipsoid.mat @ lowest
    return _at_points(plane, point[None], tangent_of(plane.axis))


def plane_cylinder(plane: Shape, cylinder: Shape) -> Contacts:
    """Four contacts: the lowest points of both caps, and two more on the rim of the lower cap.

    The three points of the lower cap form an equilateral triangle. A standing cylinder has no
    lowest rim point; its first point is then along its own x axis.
    """
    radius, half_length = cylinder.size[0], cylinder.size[1]
    normal = cylinder.mat.T @ plane.axis
    down = jnp.where(normal[2] > 0, -cylinder.axis, cylinder.axis)
    # In the cylinder's axes: if it almost stands, a radial vector computed in world axes would
    # consist of rounding errors and not be orthogonal to the axis.
    radial, _ = direction(-normal * jnp.array([1, 1, 0], normal.dtype), unit(0, normal))
    rim = cylinder.mat @ radial * radius
    side = jnp.cross(rim, down) * (np.sqrt(3.0).item() / 2)
    lower, upper = cylinder.pos + down * half_length, cylinder.pos - down * half_length
    points = jnp.stack([lower + rim, upper + rim, lower - rim / 2 + side, lower - rim / 2 - side])
    return _at_points(plane, points, tangent_of(plane.axis))


# One corner of each of a box's four diagonals; the other is its negative.
_DIAGONALS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])


def plane_box(plane: Shape, box: Shape) -> Contacts:
    """Four contacts, at the corners below the box's centre.

    One end of each diagonal is below the centre, so no sorting is needed. If a diagonal is exactly
    level, MuJoCo may keep both of its ends; here one is kept.
    """
    normal = box.mat.T @ plane.axis
    corners = jnp.asarray(_DIAGONALS, normal.dtype) * box.size[None]
    lower = jnp.where((corners @ normal)[:, None] > 0, -corners, corners)
    points = box.pos[None] + lower @ box.mat.T
    return _at_points(plane, points, tangent_of(plane.axis))


def plane_mesh(plane: Shape, mesh: Shape) -> Contacts:
    """Up to four contacts, at the lowest corner and at others of the face that looks down most.

    It is the one of the lowest corner's faces whose normal is most opposed to the plane's. If it
    has more than four corners, those of a large quadrilateral count. Corners above the mesh's
    centre do not.
    """
    normal = mesh.mat.T @ plane.axis
    corners, exists = Polytope(mesh).lowest_face(normal)
    below = lax.stop_gradient(corners @ normal) <= 0
    points = mesh.pos[None] + corners @ mesh.mat.T
    contacts = _at_points(plane, points, tangent_of(plane.axis))
    exists = exists & (below | (jnp.arange(4) == 0))
    return contacts.replace(dist=jnp.where(exists, contacts.dist, INACTIVE))


def _at_points(plane: Shape, points: Float[Array, "k 3"], tangent: Float[Array, "3"]) -> Contacts:
    def contact(x):
        dist = plane.axis @ (x - plane.pos)
        return dist, x - plane.axis * (dist / 2)

    return Contacts(*jax.vmap(contact)(points), plane.axis[None], tangent[None])
