"""`Solid`: the interface of convex solids, in their own axes.

A solid is the Minkowski sum of a core and a ball (`radius`). The support point of a core in a
direction is its point furthest along it. Support points have numbers. Equal numbers mean the same
point of the solid or, for curved solids, the same part of the surface.
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
      corners: corners, counterclockwise seen from outside; some may be repeated.
      normal: outward unit normal.
      flat: whether it is a face, not a line.
    """

    corners: Float[Array, "k 3"]
    normal: Float[Array, "3"]
    flat: Bool[Array, ""] | bool


class Solid:
    """A convex solid.

    Attributes:
      shape: the posed shape; the methods use its size, not its pose.
      curved: whether its surface has curvature.
      capped: whether it has flat faces with a curved border, orthogonal to its third axis.
      max_contacts: number of contacts that may be needed to support it: 4 for a face, 2 for a line.
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
        """Approximately half of the largest extent (m)."""
        raise NotImplementedError

    def support(self, d: Float[Array, "3"]) -> Vertex:
        """The point of the core furthest along d, and its number."""
        raise NotImplementedError

    def point(self, vertex: Vertex, n: Float[Array, "3"]) -> Float[Array, "3"]:
        """A support point as a differentiable function of the size and, if curved, of the normal.

        Args:
          vertex: result of `support` for a direction close to n.
          n: outward unit normal.
        """
        raise NotImplementedError

    def support_derivative(self, n: Float[Array, "3"], e: Float[Array, "3"]) -> Float[Array, "3"]:
        """Derivative of the support point with respect to n in the direction e; zero if flat."""
        return jnp.zeros_like(n)

    def facet(self, n: Float[Array, "3"]) -> Facet:
        """The facet with outward normal closest to n; only for `max_contacts` > 1."""
        raise NotImplementedError
