"""Lengths of vectors, with finite derivatives."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def safe_norm(x: Float[Array, "n"]) -> Float[Array, ""]:
    """`sqrt(x . x)`, whose derivative at zero is zero, the mean of all one-sided derivatives."""
    square = jnp.sum(x * x)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
