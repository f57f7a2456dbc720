"""Sine and cosine in float32, against the same in double precision."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.batching import vmap

RNG = np.random.default_rng(1)
WAVES = [(jnp.sin, np.sin), (jnp.cos, np.cos)]
waves = pytest.mark.parametrize(("f", "exact"), WAVES, ids=["sin", "cos"])
# Rounding of the result, of the reduced argument and of the polynomial, in units of 2^-24.
BOUND = 1.7 * 2.0**-24


@waves
@pytest.mark.parametrize("largest", [1e-3, 1.0, 10.0, 1e3, 1e5])
def test_accuracy(f, exact, largest):
    x = RNG.uniform(-largest, largest, 100_000).astype(np.float32)
    np.testing.assert_allclose(vmap(f)(x), exact(x.astype(float)), rtol=0, atol=BOUND)


def test_small_angles():
    """Relative accuracy where the sine is small."""
    x = np.float32(10.0) ** RNG.uniform(-30, -1, 10_000).astype(np.float32)
    for sign in (-1, 1):
        np.testing.assert_allclose(vmap(jnp.sin)(sign * x), np.sin(sign * x.astype(float)), 2e-7)


@waves
def test_multiples_of_a_quarter_turn(f, exact):
    x = (np.arange(-60_000, 60_000) * (np.pi / 2)).astype(np.float32)
    np.testing.assert_allclose(vmap(f)(x), exact(x.astype(float)), rtol=0, atol=BOUND)


@waves
def test_large_and_not_finite(f, exact):
    """Beyond 1e5 the error is that of an argument which is off by its rounding."""
    x = RNG.uniform(1e5, 1e6, 10_000).astype(np.float32)
    error = np.abs(vmap(f)(x) - exact(x.astype(float)))
    assert np.all(error <= np.spacing(x))
    found = vmap(f)(jnp.array([1e10, -1e20, 3e38, jnp.inf, -jnp.inf, jnp.nan]))
    assert np.all(np.abs(found[:3]) <= 1)
    assert np.all(np.isnan(found[3:]))


@waves
def test_float32_numbers_where_float64_is_enabled(f, exact):
    x = np.linspace(-3, 3, 100, dtype=np.float32)
    with jax.enable_x64(True):
        found = vmap(f)(jnp.asarray(x))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, exact(x.astype(float)), rtol=0, atol=BOUND)


@pytest.mark.parametrize("f", [jnp.sin, jnp.cos])
def test_derivatives(f):
    """Of first and second order, of the batch and in it, forward and reverse."""
    x = jnp.asarray(RNG.uniform(-20, 20, 50), jnp.float32)
    total = lambda g: lambda x: jnp.sum(g(x))  # noqa: E731
    expected = jax.vmap(jax.grad(f))(x)
    for d in (jax.grad, jax.jacfwd):
        np.testing.assert_allclose(vmap(d(f))(x), expected, rtol=0, atol=2e-7)
    np.testing.assert_allclose(jax.grad(total(vmap(f)))(x), expected, rtol=0, atol=2e-7)
    _, tangent = jax.jvp(vmap(f), (x,), (jnp.ones_like(x),))
    np.testing.assert_allclose(tangent, expected, rtol=0, atol=2e-7)
    for outer, inner in itertools.product((jax.grad, jax.jacfwd), repeat=2):
        np.testing.assert_allclose(vmap(outer(inner(f)))(x), -f(x), rtol=0, atol=2e-7)


@waves
def test_nested(f, exact):
    x = RNG.uniform(-20, 20, (6, 5)).astype(np.float32)
    for g in (vmap(vmap(f)), jax.vmap(vmap(f)), vmap(jax.vmap(f)), jax.jit(vmap(vmap(f)))):
        np.testing.assert_allclose(g(x), exact(x.astype(float)), rtol=0, atol=BOUND)


def test_other_types_and_options(x64):
    """Double precision, complex numbers and a requested accuracy are the library's business."""
    x = RNG.normal(size=20)
    np.testing.assert_array_equal(vmap(jnp.sin)(x), jnp.sin(x))
    np.testing.assert_array_equal(vmap(jnp.cos)(x + 1j), jnp.cos(x + 1j))
    precise = lambda x: jax.lax.sin(x, accuracy=jax.lax.AccuracyMode.HIGHEST)  # noqa: E731
    single = jnp.asarray(x, jnp.float32)
    np.testing.assert_array_equal(vmap(precise)(single), precise(single))
