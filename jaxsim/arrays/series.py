"""Coefficient functions of rotation formulas, as functions of the squared angle.

``sin(theta / 2) / theta`` and similar coefficients are even functions of the angle with a removable
singularity at zero. As functions of ``theta**2`` they are smooth: values and derivatives of every
order exist at zero, and no norm of a vector, which has no derivative there, is needed.

Each function uses its Taylor polynomial below ``SERIES_LIMIT`` and the closed form above it.
At the limit, the polynomial is exact to double precision, and the closed form has not lost digits
by cancellation.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

SERIES_LIMIT = 0.25

_COS_HALF = (1.0, -1 / 8, 1 / 384, -1 / 46080, 1 / 10321920, -1 / 3715891200)
_SINC_HALF = (1 / 2, -1 / 48, 1 / 3840, -1 / 645120, 1 / 185794560, -1 / 81749606400)
_SINE_DEFECT = (
    1 / 6,
    -1 / 120,
    1 / 5040,
    -1 / 362880,
    1 / 39916800,
    -1 / 6227020800,
    1 / 1307674368000,
)
_COTANGENT_DEFECT = (
    1 / 12,
    1 / 720,
    1 / 30240,
    1 / 1209600,
    1 / 47900160,
    691 / 1307674368000,
    1 / 74724249600,
)


def horner(coefficients: tuple[float, ...], x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Polynomial in ``x`` with the given coefficients, the constant term first."""
    total = jnp.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total = total * x + coefficient
    return total


def cos_half(theta_sq: Float[Array, ""]) -> Float[Array, ""]:
    """``cos(theta / 2)`` from ``theta**2``."""
    small, series_arg, theta = _split(theta_sq)
    return jnp.where(small, horner(_COS_HALF, series_arg), jnp.cos(theta / 2))


def sinc_half(theta_sq: Float[Array, ""]) -> Float[Array, ""]:
    """``sin(theta / 2) / theta`` from ``theta**2``; one half at zero."""
    small, series_arg, theta = _split(theta_sq)
    return jnp.where(small, horner(_SINC_HALF, series_arg), jnp.sin(theta / 2) / theta)


def sine_defect(theta_sq: Float[Array, ""]) -> Float[Array, ""]:
    """``(theta - sin(theta)) / theta**3`` from ``theta**2``; one sixth at zero."""
    small, series_arg, theta = _split(theta_sq)
    closed = (theta - jnp.sin(theta)) / theta**3
    return jnp.where(small, horner(_SINE_DEFECT, series_arg), closed)


def cotangent_defect(theta_sq: Float[Array, ""]) -> Float[Array, ""]:
    """``(1 - (theta / 2) cot(theta / 2)) / theta**2`` from ``theta**2``; one twelfth at zero.

    For angles up to pi; the cotangent is smooth there.
    """
    small, series_arg, theta = _split(theta_sq)
    half = theta / 2
    closed = (1 - half * jnp.cos(half) / jnp.sin(half)) / theta**2
    return jnp.where(small, horner(_COTANGENT_DEFECT, series_arg), closed)


def _split(theta_sq):
    """Whether the series is used, its argument, and the angle for the closed form.

    Where a branch is not used, its argument is replaced by a constant, so that its derivative is
    finite and does not spoil that of the other branch.
    """
    small = theta_sq < SERIES_LIMIT
    series_arg = jnp.where(small, theta_sq, 0.0)
    return small, series_arg, jnp.sqrt(jnp.where(small, 1.0, theta_sq))
