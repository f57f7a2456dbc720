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
class Feature:
    """A corner, an edge or a face that touches, and what it is part of.

    Attributes:
      extent: number of different corners that define it, at most three.
      number: numbers of the faces at its first corner.
      normal: their outward unit normals.
      holds: whether each face exists and contains the feature.
      corner: position of its first corner.
      ends: other ends of edges from there.
      along: whether each edge exists and contains the feature.
    """

    extent: Int[Array, ""]
    number: Int[Array, "k"]
    normal: Float[Array, "k 3"]
    holds: Bool[Array, "k"]
    corner: Float[Array, "3"]
    ends: Float[Array, "k 3"]
    along: Bool[Array, "k"]


@struct.dataclass
class Planes:
    """Planes of the faces of a solid.

    Attributes:
      normal: outward unit normals.
      offset: distances from the solid's origin, along the normals.
    """

    normal: Float[Array, "f 3"]
    offset: Float[Array, "f"]


def extent_of(numbers: Int[Array, "3"]) -> Int[Array, ""]:
    """How many of three numbers are different."""
    one, two, three = numbers
    return 1 + (two != one).astype(jnp.int32) + ((three != one) & (three != two))


class Solid:
    """A convex solid.

    Attributes:
      shape: the posed shape; the methods use its size, not its pose.
      curved: whether its surface has curvature.
      faceted: whether all its surface consists of flat faces with straight edges.
      has_faces: whether it has flat faces, see `ring`; only if `max_contacts` > 1.
      corner: its corners (m); only if faceted.
      capped: whether it has flat faces with a curved border, orthogonal to its third axis.
      max_contacts: number of contacts that may be needed to support it: 4 for a face, 2 for a line.
    """

    curved = False
    faceted = False
    has_faces = True
    capped = False
    corner: Float[Array, "v 3"]
    max_contacts = 1

    def __init__(self, shape: Shape):
        self.shape = shape
        self.size = shape.size

    @property
    def radius(self) -> Float[Array, ""]:
        """Radius of the ball around each point of the core."""
        return jnp.zeros_like(self.size[0])

    @property
    def margin(self) -> Float[Array, ""] | float:
        """Distance up to which contacts are listed (m), of the first of two solids."""
        return 0.0 if self.shape.margin is None else self.shape.margin

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

    def axes(self) -> Float[Array, "k 3"]:
        """Unit vectors along its own axes, and along edges that are not."""
        return jnp.eye(3, dtype=self.size.dtype)

    def planes(self) -> Planes | None:
        """Planes of the faces; None if these are orthogonal to the axes; only if faceted."""
        raise NotImplementedError

    def some_corners(self) -> Float[Array, "k 3"]:
        """Corners that are almost as far in every direction as all; only if faceted."""
        raise NotImplementedError

    def feature(self, numbers: Int[Array, "3"], n: Float[Array, "3"]) -> Feature:
        """The feature that three corners define, some of which may be equal.

        Only if `max_contacts` > 1.

        Args:
          numbers: of the corners.
          n: outward unit normal of the contact.
        """
        raise NotImplementedError

    def ring(self, face: Int[Array, ""]) -> tuple[Float[Array, "p 3"], Int[Array, ""] | int]:
        """Corners of a face, clockwise seen from outside, and their number; only if it has any.

        The last corner is repeated as padding.
        """
        raise NotImplementedError
