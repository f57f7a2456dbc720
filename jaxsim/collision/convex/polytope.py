"""Solids with flat faces: boxes and the hulls of meshes."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.collision.cells import cell_of
from jaxsim.collision.convex.solid import Feature, Planes, Solid, extent_of
from jaxsim.collision.shapes import Shape
from jaxsim.collision.spread import one_hot, pick
from jaxsim.lanes.switch import tracing_cpu_kernel

# Corners of a box's faces +x, -x, +y, -y, +z, -z, clockwise seen from outside, as in MuJoCo.
_BOX_RINGS = np.array(
    [
        [[1, 1, 1], [1, 1, -1], [1, -1, -1], [1, -1, 1]],
        [[-1, 1, -1], [-1, 1, 1], [-1, -1, 1], [-1, -1, -1]],
        [[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]],
        [[-1, -1, 1], [1, -1, 1], [1, -1, -1], [-1, -1, -1]],
        [[-1, 1, 1], [1, 1, 1], [1, -1, 1], [-1, -1, 1]],
        [[1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1]],
    ]
)
_CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))


class Box(Solid):
    """A box; bit k of a corner's number says whether it is on the upper side of axis k."""

    faceted = True
    max_contacts = 4

    @property
    def reach(self):
        """See `Solid`."""
        return jnp.max(self.size)

    @property
    def corner(self):
        """Its corners, see `Solid`."""
        return jnp.asarray(_CORNERS, self.size.dtype) * self.size[None]

    def support(self, d):
        """See `Solid`."""
        upper = d >= 0
        number = jnp.sum(jnp.where(upper, jnp.array([1, 2, 4], jnp.int32), 0), dtype=jnp.int32)
        return jnp.where(upper, self.size, -self.size), number

    def point(self, vertex, n):
        """See `Solid`."""
        upper = (vertex[1] >> jnp.arange(3, dtype=jnp.int32)) & 1
        return jnp.where(upper > 0, self.size, -self.size)

    def planes(self):
        """See `Solid`."""
        return None

    def some_corners(self):
        """See `Solid`."""
        return self.corner

    def feature(self, numbers, n):
        """See `Solid`."""
        numbers = jnp.sort(numbers)
        upper = ((numbers[:, None] >> jnp.arange(3, dtype=jnp.int32)[None]) & 1) > 0
        side = jnp.where(upper, 1, -1).astype(self.size.dtype)
        corners = side * self.size[None]
        extent = extent_of(numbers)
        other = jnp.where(numbers[1] != numbers[0], corners[1], corners[2])
        flipped = corners[:1] * (1 - 2 * np.eye(3, dtype=self.size.dtype))
        first = jnp.arange(3) == 0
        return Feature(
            extent=extent,
            number=2 * jnp.arange(3, dtype=jnp.int32) + jnp.where(upper[0], 0, 1),
            normal=side[0][:, None] * np.eye(3, dtype=self.size.dtype),
            holds=jnp.all(upper == upper[:1], axis=0),
            corner=corners[0],
            ends=jnp.where(extent == 1, flipped, other[None]),
            along=(extent == 1) | first & (extent == 2),
        )

    def ring(self, face):
        """See `Solid`."""
        return jnp.asarray(_BOX_RINGS, self.size.dtype)[face] * self.size[None], 4


class Polytope(Solid):
    """The convex hull of a mesh; the number of a corner is its index."""

    faceted = True
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
        if tracing_cpu_kernel():
            number = self._furthest(d)
            return self.corner[number], number
        if self.hull.near is None:
            number, corner = jnp.arange(len(self.corner), dtype=jnp.int32), self.corner
        else:
            number = self.hull.near.at(self.hull.row, cell_of(d * self.size))
            corner = self.corner[number]
        furthest = one_hot(corner @ d)
        return pick(furthest, corner), jnp.sum(jnp.where(furthest, number, 0), dtype=jnp.int32)

    def _furthest(self, d: Float[Array, "3"]) -> Int[Array, ""]:
        """The number of the first corner furthest along d, found in a loop: little code."""
        corner, d = lax.stop_gradient((self.corner, d))
        count, number = len(corner), lambda k: k
        if self.hull.near is not None:
            number = self.hull.near.numbers(self.hull.row, cell_of(d * self.size))
            count = self.hull.near.most

        def compare(k, best):
            here = corner[number(k)] @ d, number(k)
            return jax.tree.map(lambda x, y: jnp.where(here[0] > best[0], x, y), here, best)

        first = number(jnp.int32(0))
        return lax.fori_loop(1, count, compare, (corner[first] @ d, first))[1]

    def point(self, vertex, n):
        """See `Solid`."""
        return self.corner[vertex[1]]

    @property
    def faces(self):
        """Tables of the faces of all hulls."""
        if self.hull.faces is None:
            raise ValueError("several contacts need the faces of the hull")
        return self.hull.faces

    def planes(self):
        """See `Solid`."""
        normal = self.faces.normal[self.hull.row] / self.size[None]
        length = jnp.sqrt(jnp.sum(normal**2, axis=1))
        return Planes(normal / length[:, None], self.faces.offset[self.hull.row] / length)

    def some_corners(self):
        """See `Solid`."""
        some = self.hull.corner if self.hull.some is None else self.hull.some
        return some * self.size[None]

    def feature(self, numbers, n):
        """See `Solid`."""
        numbers = jnp.sort(numbers)
        of_corner = jax.vmap(self.faces.of_corner, in_axes=(None, 0), out_axes=1)
        around, (place, *_) = of_corner(self.hull.row, numbers)
        shared = (around[1:, None] == around[0][None, :, None]).any(axis=2).all(axis=0)
        before = self.faces.before[place]
        other = jnp.where(numbers[1] != numbers[0], numbers[1], numbers[2])
        extent = extent_of(numbers)
        first = jnp.arange(len(before)) == 0
        return Feature(
            extent=extent,
            number=around[0],
            normal=self._unit_normals(self.faces.normal[self.hull.row, around[0]]),
            holds=shared & (around[0] >= 0),
            corner=self.corner[numbers[0]],
            ends=self.corner[jnp.where(extent == 1, before, other)],
            along=(extent == 1) & (place >= 0) | first & (extent == 2),
        )

    def lowest_face(self, d):
        """The lowest corner along d, and three more of the face that looks down most.

        Returns:
          (4, 3) positions in order around the face, and (4,) which of them exist.
        """
        _, number = self.support(-d)
        around, places = self.faces.of_corner(self.hull.row, number)
        normals = self._unit_normals(self.faces.normal[self.hull.row, around])
        facing = one_hot(jnp.where(around >= 0, -(normals @ d), -jnp.inf))
        # A corner that hardly protrudes may be on no face: its place is -1.
        place = pick(facing, places)
        numbers = jnp.append(number, self.faces.others[place])
        exists = (numbers >= 0) & ((place >= 0) | (jnp.arange(4) == 0))
        return self.corner[numbers], exists

    def ring(self, face):
        """See `Solid`."""
        start, count = self.faces.face[self.hull.row, face]
        back = jnp.minimum(jnp.arange(self.faces.sides, dtype=jnp.int32), count - 1)
        return self.faces.ring[start + count - 1 - back] * self.size[None], count

    def _unit_normals(self, normals):
        normals = normals / self.size[None]
        return normals / jnp.sqrt(jnp.sum(normals**2, axis=1))[:, None]
