"""Solids with flat faces: boxes and the hulls of meshes."""

import jax.numpy as jnp
import numpy as np

from jaxsim.collision.convex.solid import Facet, Solid
from jaxsim.collision.shapes import Shape
from jaxsim.collision.spread import one_hot, pick


class Box(Solid):
    """A box; bit k of a corner's number says whether it is on the upper side of axis k."""

    max_contacts = 4

    @property
    def reach(self):
        """See `Solid`."""
        return jnp.max(self.size)

    def support(self, d):
        """See `Solid`."""
        upper = d >= 0
        number = jnp.sum(jnp.where(upper, jnp.array([1, 2, 4], jnp.int32), 0), dtype=jnp.int32)
        return jnp.where(upper, self.size, -self.size), number

    def point(self, vertex, n):
        """See `Solid`."""
        upper = (vertex[1] >> jnp.arange(3, dtype=jnp.int32)) & 1
        return jnp.where(upper > 0, self.size, -self.size)

    def facet(self, n):
        """See `Solid`."""
        across = one_hot(jnp.abs(n))
        x, y, z = (jnp.roll(across, shift).astype(n.dtype) for shift in (1, 2, 0))
        outward = jnp.where(n >= 0, 1, -1) * z
        side = jnp.where(jnp.sum(outward) > 0, 1, -1).astype(n.dtype)
        square = jnp.asarray(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]), n.dtype)
        corners = square @ jnp.stack([x, y * side]) + outward[None]
        return Facet(corners * self.size[None], outward, flat=True)


class Polytope(Solid):
    """The convex hull of a mesh; the number of a corner is its index."""

    max_contacts = 4

    def __init__(self, shape: Shape):
        super().__init__(shape)
        if shape.hull is None:
            raise ValueError("the shape of a mesh needs a hull")
        self.hull, self.corner = shape.hull, shape.hull.corner * shape.size[None]

    @property
    def reach(self):
        """See `Solid`."""
        return jnp.max(self.size)

    def support(self, d):
        """See `Solid`."""
        furthest = one_hot(self.corner @ d)
        order = jnp.arange(len(furthest), dtype=jnp.int32)
        return pick(furthest, self.corner), jnp.sum(jnp.where(furthest, order, 0), dtype=jnp.int32)

    def point(self, vertex, n):
        """See `Solid`."""
        return pick(jnp.arange(len(self.corner)) == vertex[1], self.corner)

    def facet(self, n):
        """See `Solid`."""
        normals = self.hull.normal / self.size[None]
        normals = normals / jnp.sqrt(jnp.sum(normals**2, axis=1))[:, None]
        facing = one_hot(normals @ n)
        number = jnp.sum(jnp.where(facing, jnp.arange(len(normals)), 0))
        corners = self.hull.faces[self.hull.row, number] * self.size[None]
        return Facet(corners, pick(facing, normals), flat=True)
