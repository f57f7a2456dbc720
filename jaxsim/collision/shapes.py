"""Records of the shape-against-shape layer: a posed shape, and the contacts of two of them.

Nothing here knows about robots, bodies or models.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.collision.frames import contact_frame

# Distance of a slot that holds no contact: finite, and beyond any margin.
INACTIVE = 1e6


@struct.dataclass
class Hull:
    """The convex hull of a mesh, in units of the shape's size.

    Meshes of different size are padded by repeating the first corner and the first face, and in
    each face the last corner.

    Attributes:
      corner: positions in the shape's axes.
      normal: outward normals of the faces; of any length.
      faces: corners around each face of all hulls, counterclockwise seen from outside. One of them
        is needed, so the others are not gathered.
      row: which of these hulls it is.
    """

    corner: Float[Array, "v 3"]
    normal: Float[Array, "f 3"]
    faces: Float[Array, "h f p 3"]
    row: Int[Array, ""]


@struct.dataclass
class HeightField:
    """A height field around its origin, in its shape's axes.

    Attributes:
      heights: of the points of all fields, rows along y, columns along x.
      row: which of these fields it is.
      count: numbers of its columns and rows.
      step: lengths of its cells.
      extent: its half-lengths.
      base: depth of the ground below the origin.
      window: so many cells along either axis are tried, enough for what may lie on it.
    """

    heights: Float[Array, "h r c"]
    row: Int[Array, ""]
    count: Int[Array, "2"]
    step: Float[Array, "2"]
    extent: Float[Array, "2"]
    base: Float[Array, ""]
    window: int = struct.field(pytree_node=False)


@struct.dataclass
class Shape:
    """A geometric primitive in the world.

    Attributes:
      pos: centre, world frame, metres.
      mat: rotation from the shape's axes to world axes; a plane's normal and the axis of a capsule
        or cylinder are its third column.
      size: MuJoCo's `geom_size`: radius (sphere), radius and half-length (capsule, cylinder),
        half-lengths (box), semi-axes (ellipsoid); X
      hull: of a mesh.
      field: of a height field.
    """

    pos: Float[Array, "3"]
    mat: Float[Array, "3 3"]
    size: Float[Array, "3"]
    hull: Hull | None = None
    field: HeightField | None = None

    @property
    def axis(self) -> Float[Array, "3"]:
        """The third axis: normal of a plane, axis of symmetry of a capsule or cylinder."""
        return self.mat[:, 2]

    @property
    def corners(self) -> Float[Array, "v 3"]:
        """Of a mesh, in the shape's axes."""
        if self.hull is None:
            raise ValueError("the shape of a mesh needs a hull")
        return self.hull.corner * self.size[None]


@struct.dataclass
class Contacts:
    """The contacts of one pair of shapes, in a number k of slots that depends on the pair only.

    Attributes:
      dist: signed distance, negative when the shapes overlap; `INACTIVE` in an empty slot.
      pos: midpoint between the two surfaces, world frame.
      normal: (k, 3) unit normals, from the first shape to the second; (1, 3) if all are the same.
      tangent: like the normals, vectors whose projections on the tangent planes are along the first
        tangents.
    """

    dist: Float[Array, "k"]
    pos: Float[Array, "k 3"]
    normal: Float[Array, "#k 3"]
    tangent: Float[Array, "#k 3"]

    @property
    def frame(self) -> Float[Array, "k 3 3"]:
        """Contact frames; rows are the normal and two tangents."""
        frame = jax.vmap(contact_frame)(self.normal, self.tangent)
        return jnp.broadcast_to(frame, (*self.pos.shape, 3))
