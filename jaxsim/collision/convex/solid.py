"""Convex solids in their own axes, as the general routine sees them: by support points.

A solid is a core and a ball around each of its points (`radius`). The support point of a core in a
direction is the one furthest along it. Vertices have numbers; what has the same number is the same
point of the solid, or for curved solids the same piece of surface.
"""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from jaxsim.collision.shapes import Shape

Vertex = tuple[Float[Array, "3"], Int[Array, ""]]


@struct.dataclass
class Facet:
    """A face of a solid, or a straight line on its surface.

    Attributes:
      corners: counterclockwise seen from outside; some may be repeated.
      normal: unit normal, outward.
      flat: whether it is a face.
    """

    corners: Float[Array, "k 3"]
    normal: Float[Array, "3"]
    flat: Bool[Array, ""] | bool


class Solid:
    """A convex solid.

    Attributes:
      shape: its record; only the size is used, not the pose.
      curved: whether its surface has curvature.
      capped: whether it has flat faces with a curved border, across its third axis.
      max_contacts: how many contacts may be needed to support it: 4 on a face, 2 on a line.
    """

    curved = False
    capped = False
    max_contacts = 1

    def __init__(self, shape: Shape):
        self.shape = shape
        self.size = shape.size

    @property
    def radius(self) -> Float[Array, ""]:
        """Radius of the ball around each point of the core."""
        return jnp.zeros_like(self.size[0])

    @property
    def reach(self) -> Float[Array, ""]:
        """Half of the largest extent, roughly."""
        raise NotImplementedError

    def support(self, d: Float[Array, "3"]) -> Vertex:
        """The core's point furthest along d, and its number."""
        raise NotImplementedError

    def point(self, vertex: Vertex, n: Float[Array, "3"]) -> Float[Array, "3"]:
        """The vertex again, as a differentiable function of sizes and, if curved, of the normal.

        Args:
          vertex: what `support` returned for a direction close to n.
          n: outward normal.
        """
        raise NotImplementedError

    def bend(self, n: Float[Array, "3"], e: Float[Array, "3"]) -> Float[Array, "3"]:
        """Derivative of the support point with respect to n along e: zero where it is flat."""
        return jnp.zeros_like(n)

    def facet(self, n: Float[Array, "3"]) -> Facet:
        """The facet that looks along n, if there may be more than one contact."""
        raise NotImplementedError
