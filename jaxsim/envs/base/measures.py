"""Functions for rewards, with derivatives everywhere."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float


def distance(x: Float[Array, "n"]) -> Float[Array, ""]:
    """Euclidean norm, with derivative zero at zero."""
    square = jnp.sum(x**2)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def near_zero(x: Float[Array, "..."], margin: float | Array) -> Float[Array, "..."]:
    """One at zero, 0.1 at +-margin: `exp(log(0.1) (x / margin)^2)`, a Gaussian."""
    return jnp.exp(math.log(0.1) * (x / margin) ** 2)


def wrapped(angle: Float[Array, "..."]) -> Float[Array, "..."]:
    """The angle modulo whole turns, within [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
