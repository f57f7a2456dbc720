"""Estimators on functions whose averages are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.gradients import first_order, mixed, zeroth_order

SAMPLES = 20_000


def both(f, theta, sigma):
    """Two estimates from different samples, and their mix."""

    def run(key):
        k1, k0 = jax.random.split(key)
        first = first_order(f, theta, k1, sigma=sigma, samples=SAMPLES)
        zeroth = zeroth_order(f, theta, k0, sigma=sigma, samples=SAMPLES)
        return first, zeroth, mixed(first, zeroth)

    return quick_jit(run)(jax.random.key(0))


def test_a_smoothed_step(x64):
    """Case G16: `E[theta + sigma xi > 0]`. Gradients of the samples are zero, and told apart."""
    f = lambda theta, key: jnp.where(theta > 0, 1.0, 0.0)  # noqa: E731
    first, zeroth, mix = both(f, jnp.array(0.5), 1.0)
    np.testing.assert_allclose(zeroth.value, 0.691462461274, atol=0.01)
    assert first.gradient == 0
    # Four standard deviations, themselves about half a per cent.
    error = abs(float(zeroth.gradient) - 0.352065326764)
    assert error < 4 * np.sqrt(zeroth.variance) < 0.03
    assert mix.biased
    assert mix.weight == 0
    assert mix.estimate.gradient == zeroth.gradient


def test_a_smooth_function_of_a_tree(x64):
    """`E |a + sigma xi|^2 + b E k = |a|^2 + n sigma^2 + b / 2`; first order is the surer one."""
    theta = {"a": jnp.array([1.0, -2.0]), "b": jnp.array(3.0)}
    f = lambda t, key: jnp.sum(t["a"] ** 2) + t["b"] * jax.random.uniform(key)  # noqa: E731
    first, zeroth, mix = both(f, theta, 0.1)
    expected = {"a": np.array([2.0, -4.0]), "b": 0.5}
    for found in (first, zeroth, mix.estimate):
        square = sum(np.sum((found.gradient[n] - expected[n]) ** 2) for n in expected)
        assert square < 16 * found.variance
        np.testing.assert_allclose(found.value, 5 + 2 * 0.01 + 1.5, atol=0.05)
    assert not mix.biased
    assert mix.weight > 0.9
    assert mix.estimate.variance < min(first.variance, zeroth.variance)


def test_variance_is_that_of_repetition(x64):
    """The variance of many estimates is what each of them says of itself."""
    f = lambda theta, key: jnp.sin(3 * theta)  # noqa: E731

    def run(key):
        found = zeroth_order(f, jnp.array(0.2), key, sigma=0.5, samples=50)
        return found.gradient, found.variance

    gradients, variances = quick_jit(jax.vmap(run))(jax.random.split(jax.random.key(1), 2000))
    exact = 3 * np.cos(0.6) * np.exp(-9 * 0.25 / 2)
    np.testing.assert_allclose(gradients.mean(), exact, atol=4 * np.sqrt(variances.mean() / 2000))
    np.testing.assert_allclose(gradients.var(), variances.mean(), rtol=0.1)


def test_wrong_arguments_are_told(key):
    with pytest.raises(ValueError, match="two samples"):
        first_order(lambda x, k: x, 0.0, key, sigma=1.0, samples=1)
    with pytest.raises(ValueError, match="needs noise"):
        zeroth_order(lambda x, k: x, 0.0, key, sigma=0.0, samples=2)
