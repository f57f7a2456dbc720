"""Arguments and results of pair functions: posed shapes, and contacts of two shapes.

They do not depend on robots, bodies or models.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.collision.frames import contact_frame

# Distance in a slot without a contact: finite and larger than any margin.
INACTIVE = 1e6


@struct.dataclass
class HullFaces:
    """Tables of the faces of all hulls, in units of the shape's size.

    They are tables of all hulls, because only a few rows of them are gathered.

    Attributes:
      normal: outward normals of the faces, of any length.
      offset: scalar products of these with points on the faces.
      face: where the corners of each face start in `ring`, and their number.
      ring: corners around the faces, counterclockwise seen from outside.
      at: where the faces at each corner start in `around` and `place`, and their number.
      around: numbers of these faces, ascending.
      place: the corner's place in each of these faces, in the tables of places.
      before: number of the corner before each place.
      others: numbers of three corners that make a large quadrilateral with the one of each place,
        in order; -1 where the face has less.
      sides: largest number of corners of a face in `ring`.
      degree: largest number of faces at a corner.
    """

    normal: Float[Array, "h f 3"]
    offset: Float[Array, "h f"]
    face: Int[Array, "h f 2"]
    ring: Float[Array, "r 3"]
    at: Int[Array, "h v 2"]
    around: Int[Array, "q"]
    place: Int[Array, "q"]
    before: Int[Array, "p"]
    others: Int[Array, "p 3"]
    sides: int = struct.field(pytree_node=False)
    degree: int = struct.field(pytree_node=False)

    def of_corner(self, row: Int[Array, ""], corner: Int[Array, ""]) -> Int[Array, "2 k"]:
        """Numbers of the faces at a corner, and its places in them; -1 where there are no more."""
        start, count = self.at[row, corner]
        k = jnp.arange(self.degree, dtype=jnp.int32)
        found = jnp.stack(
            [table[start + jnp.minimum(k, count - 1)] for table in (self.around, self.place)]
        )
        return jnp.where(k[None] < count, found, -1)


@struct.dataclass
class HullCells:
    """Tables of the corners of all hulls that may be the furthest in each cell of directions.

    Attributes:
      cell: where the numbers of a cell's corners start in `corner`, and how many they are; see
        `jaxsim.collision.cells`.
      corner: numbers of corners.
      most: largest number of corners of a cell.
    """

    cell: Int[Array, "h c 2"]
    corner: Int[Array, "r"]
    most: int = struct.field(pytree_node=False)

    def at(self, row: Int[Array, ""], cell: Int[Array, ""]) -> Int[Array, "n"]:
        """Numbers of the corners of a cell of a hull; the last is repeated as padding."""
        return self.numbers(row, cell)(jnp.arange(self.most, dtype=jnp.int32))

    def numbers(
        self, row: Int[Array, ""], cell: Int[Array, ""]
    ) -> Callable[[Int[Array, "*k"]], Int[Array, "*k"]]:
        """The same as a function of the place in that list, from 0 to `most` - 1."""
        start, count = self.cell[row, cell]
        return lambda k: self.corner[start + jnp.minimum(k, count - 1)]


@struct.dataclass
class Hull:
    """The convex hull of a mesh, in units of the shape's size.

    Hulls of different size are padded by repeating the first corner and the first face.

    Attributes:
      corner: positions of the corners in the shape's axes.
      row: row of this hull in the tables of faces.
      some: corners that are almost as far in every direction as all; None for all.
      near: which corners may be the furthest in each cell of directions; None for all.
      faces: tables of faces; None if at most one contact is computed.
    """

    corner: Float[Array, "v 3"]
    row: Int[Array, ""]
    some: Float[Array, "k 3"] | None = None
    near: HullCells | None = None
    faces: HullFaces | None = None


@struct.dataclass
class HeightField:
    """A height field centred at its origin, in its shape's axes; lengths in metres.

    Attributes:
      heights: heights of the points of all fields, rows along y, columns along x.
      row: row of this field in `heights`.
      count: its numbers of columns and rows.
      step: lengths of its cells along x and y.
      extent: its half-lengths along x and y.
      base: depth of the ground below the origin.
      window: number of cells along each axis that are tested, enough for all geoms that may lie on
        it.
    """

    heights: Float[Array, "h r c"]
    row: Int[Array, ""]
    count: Int[Array, "2"]
    step: Float[Array, "2"]
    extent: Float[Array, "2"]
    base: Float[Array, ""]
    window: int = struct.field(pytree_node=False)


@struct.dataclass
class Distances:
    """The signed distance function of a shape, one of several.

    Attributes:
      row: which one.
      parameters: second argument of each function; None for functions without.
      functions: from a point in the shape's axes (m) to a signed distance (m), static.
    """

    row: Int[Array, ""]
    parameters: tuple[Any, ...]
    functions: tuple[Callable[..., Float[Array, ""]], ...] = struct.field(pytree_node=False)

    def __call__(self, x: Float[Array, "3"]) -> Float[Array, ""]:
        """The signed distance at a point."""
        given = zip(self.functions, self.parameters, strict=True)
        first, *others = [f(x) if p is None else f(x, p) for f, p in given]
        for k, other in enumerate(others, 1):
            first = jnp.where(self.row == k, other, first)
        return first


@struct.dataclass
class Shape:
    """A geometric primitive in the world.

    Attributes:
      pos: centre, world frame, metres.
      mat: rotation from the shape's axes to world axes; a plane's normal and the axis of a capsule
        or cylinder are its third column.
      size: MuJoCo's `geom_size`: radius (sphere), radius and half-length (capsule, cylinder),
        half-lengths (box), semi-axes (ellipsoid), largest coordinates (mesh), half-lengths of a box
        that contains it (signed distance function).
      hull: convex hull, for a mesh.
      field: heights, for a height field.
      sdf: signed distance function, for a shape that has one.
      margin: distance up to which contacts with the other shape are listed, for the first of two
        shapes with faces (m).
    """

    pos: Float[Array, "3"]
    mat: Float[Array, "3 3"]
    size: Float[Array, "3"]
    hull: Hull | None = None
    field: HeightField | None = None
    sdf: Distances | None = None
    margin: Float[Array, ""] | None = None

    @property
    def axis(self) -> Float[Array, "3"]:
        """The third axis: normal of a plane, axis of symmetry of a capsule or cylinder."""
        return self.mat[:, 2]

    @property
    def corners(self) -> Float[Array, "v 3"]:
        """Corners of a mesh's hull in the shape's axes (m)."""
        if self.hull is None:
            raise ValueError("the shape of a mesh needs a hull")
        return self.hull.corner * self.size[None]


@struct.dataclass
class Contacts:
    """The contacts of two shapes; their number k depends only on the types of the shapes.

    Attributes:
      dist: signed distance (m), negative if the shapes overlap; `INACTIVE` in an empty slot.
      pos: midpoint between the two surfaces, world frame (m).
      normal: (k, 3) unit normals, from the first shape to the second; (1, 3) if all are equal.
      tangent: (k, 3) or (1, 3) vectors; their projections on the tangent planes are along the
        first tangents.
      others: (m,) distances of further contacts, for which the pair has no slots, large where
        there are none; None if a pair always has enough slots.
    """

    dist: Float[Array, "k"]
    pos: Float[Array, "k 3"]
    normal: Float[Array, "#k 3"]
    tangent: Float[Array, "#k 3"]
    others: Float[Array, "m"] | None = None

    @classmethod
    def none(cls, count: int, dtype) -> "Contacts":
        """Empty slots."""
        x, y, _ = jnp.eye(3, dtype=dtype)
        dist, pos = jnp.full(count, INACTIVE, dtype), jnp.zeros((count, 3), dtype)
        return cls(dist, pos, normal=x[None], tangent=y[None])

    @property
    def frame(self) -> Float[Array, "k 3 3"]:
        """Contact frames; rows are the normal and two tangents."""
        frame = jax.vmap(contact_frame)(self.normal, self.tangent)
        return jnp.broadcast_to(frame, (*self.pos.shape, 3))
