"""`Manifold`: the contacts of two convex solids."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.collision.convex.touch import Touch


@struct.dataclass
class Manifold:
    """Contacts of two solids, in the axes of the first and about its centre.

    Attributes:
      dist: signed distances along the normal.
      middle: points half-way between the surfaces.
      exists: whether each contact exists.
      normal: unit normal from the first to the second.
    """

    dist: Float[Array, "k"]
    middle: Float[Array, "k 3"]
    exists: Bool[Array, "k"]
    normal: Float[Array, "3"]

    @classmethod
    def of(cls, touch: Touch, count: int = 1) -> "Manifold":
        """A single contact in `count` slots."""
        middle = jnp.broadcast_to((touch.first + touch.second) / 2, (count, 3))
        exists = jnp.arange(count) == 0
        return cls(jnp.broadcast_to(touch.dist, count), middle, exists, touch.normal)

    def in_slots(self, count: int) -> "Manifold":
        """The same contacts in fewer slots."""
        return self.replace(
            dist=self.dist[:count], middle=self.middle[:count], exists=self.exists[:count]
        )
