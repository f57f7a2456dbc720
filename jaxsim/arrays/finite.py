"""Whether numbers are finite, as a number that spoils others where they are not."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def zero_if_finite(tree: Any) -> Float[Array, ""]:
    """Zero if all floating-point numbers of a pytree are finite, else NaN."""
    leaves = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    return jnp.asarray(sum(jnp.sum(x - x) for x in leaves))
