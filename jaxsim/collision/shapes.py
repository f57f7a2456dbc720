"""Records of the shape-against-shape layer: a posed shape, and the contacts of two of them.

Nothing here knows about robots, bodies or models.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.collision.frames import contact_frame

# Distance of a slot that holds no contact: finite, and beyond any margin.
INACTIVE = 1e6


@struct.dataclass
class Shape:
    """A geometric primitive in the world.

    Attributes:
      pos: centre, world frame, metres.
      mat: rotation from the shape's axes to world axes; a plane's normal and the axis of a capsule
        or cylinder are its third column.
      size: MuJoCo's `geom_size`: radius (sphere), radius and half-length (capsule, cylinder),
        half-lengths (box), semi-axes (ellipsoid); a plane is infinite and ignores it.
    """

    pos: Float[Array, "3"]
    mat: Float[Array, "3 3"]
    size: Float[Array, "3"]

    @property
    def axis(self) -> Float[Array, "3"]:
        """The third axis: normal of a plane, axis of symmetry of a capsule or cylinder."""
        return self.mat[:, 2]


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
