"""Spheres and capsules against each other.

A capsule is the set of points within its radius of a segment, so each of these pairs comes down to
two spheres centred at the closest points of two segments.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.collision.frames import direction, frame_of_normal, smallest_length, unit
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape

# Squared area of the axes' parallelogram below which MuJoCo calls two capsules parallel (mjMINVAL).
PARALLEL = 1e-15


def sphere_sphere(first: Shape, second: Shape, _reach: Float[Array, ""]) -> Contacts:
    """One contact, on the line of the centres.

    Coincident centres have no such line: the normal is then the cross product of the third axes, or
    the world's x axis if these are parallel, and the distance has derivative zero.
    """
    return _spheres(first, second, jnp.zeros(1, first.pos.dtype), jnp.zeros(1, first.pos.dtype))


def sphere_capsule(sphere: Shape, capsule: Shape, _reach: Float[Array, ""]) -> Contacts:
    """One contact, with the point of the capsule's segment closest to the sphere's centre."""
    along = capsule.axis @ (sphere.pos - capsule.pos) / capsule.size[1]
    return _spheres(sphere, capsule, jnp.zeros(1, along.dtype), jnp.clip(along, -1, 1)[None])


def capsule_capsule(first: Shape, second: Shape, reach: Float[Array, ""]) -> Contacts:
    """One contact at the closest points of the two segments, or two if the axes are parallel.

    Points of the segments are `p_i + x_i a_i`, a_i the half-length vectors, x_i in [-1, 1], and
    d = p_1 - p_2. The lines' closest points have `x_1 = -(d x a_2) . w / w . w, w = a_1 x a_2`.
    Parallel capsules have no unique answer; like MuJoCo, take the first two ends within `reach` of
    the other capsule, in the order +a_1, -a_1, +a_2, -a_2.

    Args:
      first: a capsule.
      second: a capsule.
      reach: distance within which contacts count; it only decides which ends are kept.
    """
    segments = _Segments(first, second)
    x1, x2 = segments.closest()
    ends1, ends2, found = segments.closest_ends(reach + first.size[0] + second.size[0])
    two = segments.parallel & found
    x1 = jnp.where(two, ends1, x1)
    x2 = jnp.where(two, ends2, x2)
    contacts = _spheres(first, second, x1, x2)
    empty = jnp.stack([jnp.zeros_like(two[0]), ~two[1]])
    return contacts.replace(dist=jnp.where(empty, INACTIVE, contacts.dist))


class _Segments:
    """Two segments `p_i + x_i a_i` and the points that are closest to each other."""

    def __init__(self, first: Shape, second: Shape):
        self.a1 = first.axis * first.size[1]
        self.a2 = second.axis * second.size[1]
        self.d = first.pos - second.pos
        self.square1, self.square2 = self.a1 @ self.a1, self.a2 @ self.a2
        # By cross products, because a Gram determinant cancels in float32 long before the axes
        # are parallel.
        self.w = jnp.cross(self.a1, self.a2)
        self.area = self.w @ self.w
        noise = (2 * smallest_length(self.d)) ** 2 * self.square1 * self.square2
        self.parallel = self.area < jnp.maximum(PARALLEL, noise)

    def onto_first(self, x2: Float[Array, "..."]) -> Float[Array, "..."]:
        """Closest point of the first segment to a point of the second."""
        return jnp.clip((x2 * (self.a1 @ self.a2) - self.a1 @ self.d) / self.square1, -1, 1)

    def onto_second(self, x1: Float[Array, "..."]) -> Float[Array, "..."]:
        """Closest point of the second segment to a point of the first."""
        return jnp.clip((x1 * (self.a1 @ self.a2) + self.a2 @ self.d) / self.square2, -1, 1)

    def closest(self) -> tuple[Float[Array, "1"], Float[Array, "1"]]:
        """The closest points; some pair of them if the segments are parallel."""
        area = jnp.where(self.parallel, 1.0, self.area)
        x1 = jnp.clip(-jnp.cross(self.d, self.a2) @ self.w / area, -1, 1)
        x2 = self.onto_second(x1)
        return self.onto_first(x2)[None], x2[None]

    def closest_ends(self, radius: Float[Array, ""]):
        """The first two ends whose closest point on the other segment is within a radius.

        Returns:
          `x_1` (2,), `x_2` (2,), and whether there is a first and a second such end (2,).
        """
        ends = jnp.asarray([1.0, -1.0], self.d.dtype)
        x1 = jnp.concatenate([ends, self.onto_first(ends)])
        x2 = jnp.concatenate([self.onto_second(ends), ends])
        apart = jax.vmap(lambda y1, y2: self.d + y1 * self.a1 - y2 * self.a2)(x1, x2)
        within = jnp.sum(apart * apart, axis=1) <= radius**2
        place = jnp.cumsum(within.astype(int))
        chosen = jnp.stack([within & (place == 1), within & (place == 2)])

        def pick(x):
            return jnp.sum(jnp.where(chosen, x[None], 0.0), axis=1)

        return pick(x1), pick(x2), jnp.any(chosen, axis=1)


def _spheres(first: Shape, second: Shape, x1: Float[Array, "k"], x2: Float[Array, "k"]) -> Contacts:
    """Contacts of spheres centred at fractions `x_i` of the shapes' half-lengths."""
    r1, r2 = first.size[0], second.size[0]
    fallback, _ = direction(jnp.cross(first.axis, second.axis), unit(0, first.pos))

    def contact(y1, y2):
        centre1 = first.pos + first.axis * (first.size[1] * y1)
        centre2 = second.pos + second.axis * (second.size[1] * y2)
        normal, length = direction(centre2 - centre1, fallback)
        dist = length - r1 - r2
        return dist, centre1 + normal * (r1 + dist / 2), frame_of_normal(normal)

    return Contacts(*jax.vmap(contact)(x1, x2))
