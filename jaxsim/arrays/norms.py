"""Lengths of vectors, with finite derivatives."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def safe_norm(x: Float[Array, "n"]) -> Float[Array, ""]:
    """`sqrt(x . x)`, whose derivative at zero is zero, the mean of all one-sided derivatives."""
    return norm_and_divisor(x)[0]


def norm_and_divisor(x: Float[Array, "n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`safe_norm(x)`, and the same with one in place of zero, by which x may be divided."""
    square = jnp.sum(x * x)
    divisor = jnp.sqrt(jnp.where(square > 0, square, 1.0))
    return jnp.where(square > 0, divisor, 0.0), divisor
