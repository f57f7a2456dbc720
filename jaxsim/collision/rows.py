"""Rows of a per-geom array, for ids that are known when the model is built or only at run time."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxsim.dynamics.tree import take

Index = Int[Array, "n"] | np.ndarray


def rows(values, index: Index) -> Array:
    """`values[index]`; a numpy index is static and becomes slices where that is cheaper."""
    values = jnp.asarray(values)
    return take(values, index) if isinstance(index, np.ndarray) else values[index]
