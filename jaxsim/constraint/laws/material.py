"""What geoms are made of: the parameters of the laws that MuJoCo does not have."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import Index, gather
from jaxsim.model import Model


@struct.dataclass
class Material:
    """Of one contact, or of n.

    Attributes:
      stiffness: k, force by penetration (N/m).
      relaxation: tau, the time in which penetration decays (s).
      restitution: e, speed after an impact by the speed before, between 0 and 1.
    """

    stiffness: Float[Array, "..."]
    relaxation: Float[Array, "..."]
    restitution: Float[Array, "..."]


def contact_material(model: Model, geom1: Index, geom2: Index) -> Material:
    """Of contacts between geoms: two springs and dampers in series, the larger restitution."""
    k1, k2, t1, t2, e1, e2 = (
        gather(values, geom)
        for values in (model.geom_stiffness, model.geom_relaxation, model.geom_restitution)
        for geom in (geom1, geom2)
    )
    return Material(k1 * k2 / (k1 + k2), t1 + t2, jnp.maximum(e1, e2))
