"""Norms of vectors with finite derivatives at zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def safe_norm(x: Float[Array, "n"]) -> Float[Array, ""]:
    """`sqrt(x . x)`; its derivative at zero is zero, the mean of all one-sided derivatives."""
    return norm_and_divisor(x)[0]


def norm_and_divisor(x: Float[Array, "n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`safe_norm(x)`, and a divisor that normalises x: the norm again, or one where it is zero."""
    square = jnp.sum(x * x)
    divisor = jnp.sqrt(jnp.where(square > 0, square, 1.0))
    return jnp.where(square > 0, divisor, 0.0), divisor
