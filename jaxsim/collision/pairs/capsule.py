"""Spheres and capsules against each other.

A capsule is the set of points within its radius of a segment. So each of these pairs is reduced to
two spheres, centred at the closest points of two segments.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.collision.frames import direction, tangent_of, unit
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape

# Two axes are parallel if the squared sine of their angle is below this, as in MuJoCo 3.17.
PARALLEL = 1e-8


def sphere_sphere(first: Shape, second: Shape) -> Contacts:
    """One contact, on the line of the centres.

    If the centres coincide, the normal is the cross product of the third axes, or the world's x
    axis if these are parallel, and the distance has derivative zero.
    """
    centre = jnp.zeros(1, first.pos.dtype)
    return _spheres(first, second, centre, centre)


def sphere_capsule(sphere: Shape, capsule: Shape) -> Contacts:
    """One contact, with the point of the capsule's segment closest to the sphere's centre."""
    along = capsule.axis @ (sphere.pos - capsule.pos) / capsule.size[1]
    return _spheres(sphere, capsule, jnp.zeros(1, along.dtype), jnp.clip(along, -1, 1)[None])


def capsule_capsule(first: Shape, second: Shape) -> Contacts:
    """One contact at the closest points of the two segments, or two if the axes are parallel.

    Parallel capsules touch along a line. The two contacts are at the ends of the part where both
    segments overlap, or both at the tips if they do not. Otherwise the second slot is empty.
    """
    segments = _Segments(first, second)
    x1, x2 = segments.closest()
    end1, end2 = jax.vmap(segments.end_of_overlap)(jnp.asarray([-1.0, 1.0], x1.dtype))
    parallel = segments.parallel
    contacts = _spheres(first, second, jnp.where(parallel, end1, x1), jnp.where(parallel, end2, x2))
    empty = jnp.array([False, True]) & ~parallel
    return contacts.replace(dist=jnp.where(empty, INACTIVE, contacts.dist))


class _Segments:
    """Two segments `p_i + x_i a_i`, x_i in [-1, 1], where d = p_1 - p_2 and w = a_1 x a_2."""

    def __init__(self, first: Shape, second: Shape):
        self.a1 = first.axis * first.size[1]
        self.a2 = second.axis * second.size[1]
        self.d = first.pos - second.pos
        self.square1, self.square2 = self.a1 @ self.a1, self.a2 @ self.a2
        # By a cross product: in float32, a Gram determinant loses all digits for small angles.
        self.w = jnp.cross(self.a1, self.a2)
        self.area = self.w @ self.w
        self.parallel = self.area < PARALLEL * self.square1 * self.square2

    def onto_first(self, x2: Float[Array, ""]) -> Float[Array, ""]:
        """Point of the first line closest to a point of the second."""
        return (x2 * (self.a1 @ self.a2) - self.a1 @ self.d) / self.square1

    def onto_second(self, x1: Float[Array, ""]) -> Float[Array, ""]:
        """Point of the second line closest to a point of the first."""
        return (x1 * (self.a1 @ self.a2) + self.a2 @ self.d) / self.square2

    def closest(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Parameters x1, x2 of the closest points.

        For the lines, `x_1 = -(d x a_2) . w / w . w`. Clipping to one segment and projecting to the
        other, twice, gives the closest points of the segments.
        """
        area = jnp.where(self.parallel, 1.0, self.area)
        x1 = jnp.clip(-jnp.cross(self.d, self.a2) @ self.w / area, -1, 1)
        x2 = jnp.clip(self.onto_second(x1), -1, 1)
        return jnp.clip(self.onto_first(x2), -1, 1), x2

    def end_of_overlap(self, end2: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Parameters of the end of parallel segments' overlap on the side of `x_2 = end2`."""
        x1 = self.onto_first(end2)
        inside = jnp.abs(x1) < 1
        x1 = jnp.clip(x1, -1, 1)
        return x1, jnp.where(inside, end2, jnp.clip(self.onto_second(x1), -1, 1))


def _spheres(first: Shape, second: Shape, x1: Float[Array, "k"], x2: Float[Array, "k"]) -> Contacts:
    """Contacts of spheres centred at fractions `x_i` of the shapes' half-lengths."""
    r1, r2 = first.size[0], second.size[0]
    fallback, _ = direction(jnp.cross(first.axis, second.axis), unit(0, first.pos))

    def contact(y1, y2):
        centre1 = first.pos + first.axis * (first.size[1] * y1)
        centre2 = second.pos + second.axis * (second.size[1] * y2)
        normal, length = direction(centre2 - centre1, fallback)
        dist = length - r1 - r2
        return dist, centre1 + normal * (r1 + dist / 2), normal, tangent_of(normal)

    return Contacts(*jax.vmap(contact)(x1, x2))
