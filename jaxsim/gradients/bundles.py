"""Estimators of the gradient of an averaged objective, `F(theta) = E f(theta + sigma xi, key)`.

xi is standard normal. The mean of gradients (first order) has little variance if f is smooth, but
it misses the contribution of discontinuities. The mean of values times noise (zeroth order) is
unbiased for every f, but has more variance. See Suh, Simchowitz, Zhang and Tedrake (2022), "Do
differentiable simulators give better policy gradients?".
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

Objective = Callable[[Any, jax.Array], Float[Array, ""]]


class Estimate(NamedTuple):
    """An estimate of a gradient.

    Attributes:
      gradient: the gradient, with the structure of theta.
      variance: expected squared distance from the estimator's mean.
      value: estimate of `F(theta)`.
    """

    gradient: Any
    variance: Float[Array, ""]
    value: Float[Array, ""]


class Mix(NamedTuple):
    """A weighted mean of two estimates.

    Attributes:
      estimate: the weighted mean.
      weight: weight of the first-order estimate; zero if it is biased.
      bias: distance of the two gradients from each other.
      bias_std: standard deviation of that distance by chance.
      biased: whether the distance is larger than chance explains, so that the first-order estimate
        is wrong.
    """

    estimate: Estimate
    weight: Float[Array, ""]
    bias: Float[Array, ""]
    bias_std: Float[Array, ""]
    biased: Bool[Array, ""]


def first_order(f: Objective, theta: Any, key: jax.Array, *, sigma: float, samples: int):
    """Mean of `grad f(theta + sigma xi_i, key_i)`.

    Args:
      f: scalar function of theta and a random key.
      theta: point at which to estimate; any pytree of arrays.
      key: random key of the samples.
      sigma: standard deviation of the noise; zero if only the key is random.
      samples: number of samples, at least two.
    """
    x, back, xi, keys = _samples(theta, key, samples)
    one = lambda noise, key: jax.value_and_grad(lambda x: f(back(x), key))(x + sigma * noise)  # noqa: E731
    values, gradients = jax.vmap(one)(xi, keys)
    return _estimate(back, gradients, values)


def zeroth_order(f: Objective, theta: Any, key: jax.Array, *, sigma: float, samples: int):
    """Mean of `(f(theta + sigma xi_i, key_i) - b_i) xi_i / sigma`.

    The baseline b_i is the mean of the other values, which reduces the variance without bias.

    Args:
      f: scalar function of theta and a random key; it need not be continuous.
      theta: point at which to estimate; any pytree of arrays.
      key: random key of the samples.
      sigma: standard deviation of the noise.
      samples: number of samples, at least two.
    """
    if not sigma > 0:
        raise ValueError(f"zeroth order needs noise, got sigma = {sigma}")
    x, back, xi, keys = _samples(theta, key, samples)
    values = jax.vmap(lambda noise, key: f(back(x + sigma * noise), key))(xi, keys)
    others = (values.sum() - values) / (samples - 1)
    return _estimate(back, (values - others)[:, None] * xi / sigma, values)


def mixed(first: Estimate, zeroth: Estimate, *, confidence: float = 3.0) -> Mix:
    """The inverse-variance weighted mean of two estimates; only the second if the first is biased.

    Args:
      first: first-order estimate.
      zeroth: zeroth-order estimate of the same gradient, from other samples.
      confidence: distance, in standard deviations, above which the first counts as biased.
    """
    g1, back = ravel_pytree(first.gradient)
    g0, _ = ravel_pytree(zeroth.gradient)
    total = first.variance + zeroth.variance
    bias, std = jnp.sqrt(jnp.sum((g1 - g0) ** 2)), jnp.sqrt(total)
    biased = bias > confidence * std
    share = zeroth.variance / jnp.where(total > 0, total, 1.0)
    weight = jnp.where(biased, 0.0, jnp.where(total > 0, share, 0.5))
    mix = lambda a, b: weight * a + (1 - weight) * b  # noqa: E731
    variance = weight**2 * first.variance + (1 - weight) ** 2 * zeroth.variance
    estimate = Estimate(back(mix(g1, g0)), variance, mix(first.value, zeroth.value))
    return Mix(estimate, weight, bias, std, biased)


def _samples(theta, key, samples: int):
    if samples < 2:
        raise ValueError(f"an estimate of variance needs two samples, got {samples}")
    x, back = ravel_pytree(theta)
    noise, keys = jax.random.split(key)
    xi = jax.random.normal(noise, (samples, x.size), x.dtype)
    return x, back, xi, jax.random.split(keys, samples)


def _estimate(back, gradients: Float[Array, "n p"], values: Float[Array, "n"]) -> Estimate:
    n = gradients.shape[0]
    spread = jnp.sum((gradients - gradients.mean(0)[None]) ** 2) / (n - 1)
    return Estimate(back(gradients.mean(0)), spread / n, values.mean())
