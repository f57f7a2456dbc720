"""Lengths with derivatives that are finite everywhere."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.arrays.norms import norm_and_divisor, safe_norm


def test_length_and_its_derivatives(x64):
    x = jnp.array([3.0, 0.0, -4.0])
    length, gradient = jax.value_and_grad(safe_norm)(x)
    np.testing.assert_allclose(length, 5)
    np.testing.assert_allclose(gradient, x / 5)
    np.testing.assert_allclose(norm_and_divisor(x), [5, 5])


def test_zero_has_length_zero_derivative_zero_and_divisor_one():
    zero = jnp.zeros(3)
    for derivative in (jax.grad, jax.jacfwd):
        np.testing.assert_array_equal(derivative(safe_norm)(zero), np.zeros(3))
    np.testing.assert_array_equal(norm_and_divisor(zero), [0, 1])
