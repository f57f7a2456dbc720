"""`SolidPair`: two solids in the axes of the first, and their support points."""

import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.collision.convex.solid import Solid


@struct.dataclass
class Vertices:
    """Support points of both solids, in the first one's axes and about its centre.

    Attributes:
      first: points of the first solid.
      second: points of the second solid.
      numbers: numbers of both points, see `Solid.support`.
    """

    first: Float[Array, "*k 3"]
    second: Float[Array, "*k 3"]
    numbers: Int[Array, "*k 2"]

    @property
    def difference(self) -> Float[Array, "*k 3"]:
        """Points of the Minkowski difference."""
        return self.second - self.first


class SolidPair:
    """Two solids in the axes of the first.

    Attributes:
      first, second: the solids.
      rot: (3, 3) columns are the axes of the second.
      centre: (3,) centre of the second (m).
    """

    def __init__(self, first: Solid, second: Solid):
        self.first, self.second = first, second
        here, there = first.shape, second.shape
        self.rot = here.mat.T @ there.mat
        self.centre = here.mat.T @ (there.pos - here.pos)

    def support(self, n: Float[Array, "3"]) -> Vertices:
        """Support points of the first solid along n and of the second along -n."""
        a, number1 = self.first.support(n)
        b, number2 = self.second.support(-(n @ self.rot))
        return Vertices(a, self.centre + self.rot @ b, jnp.stack([number1, number2]))

    @property
    def size(self) -> Float[Array, ""]:
        """Size of the smaller solid, the length scale of tolerances (m)."""
        return jnp.minimum(self.first.reach, self.second.reach)

    @property
    def rounding(self) -> Float[Array, ""]:
        """Lengths below this may be rounding errors, also if one solid is small (m)."""
        largest = lax.stop_gradient(jnp.maximum(self.first.reach, self.second.reach))
        return 8 * float(jnp.finfo(largest.dtype).eps) * largest
