"""Distributions agree with SciPy-free closed forms; actions fit the environment."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.rl.networks import (
    MLP,
    ActionRange,
    Gaussian,
    GaussianPolicy,
    Policy,
    TanhGaussian,
    TanhGaussianPolicy,
    Value,
    divergence,
)
from jaxsim.rl.normalize import RunningStatistics


def gaussian(mean, std):
    return Gaussian(jnp.array(mean), jnp.log(jnp.array(std)))


def grid(limit, count=20001):
    return jnp.linspace(-limit, limit, count)[:, None]


def test_gaussian_density_integrates_to_one_and_has_its_entropy():
    d, x = gaussian([0.3], [0.7]), grid(8.0)
    density = jnp.exp(jax.vmap(d.log_prob)(x))
    width = 16.0 / 20000
    np.testing.assert_allclose(density.sum() * width, 1, rtol=1e-4)
    entropy = -(density * jnp.log(jnp.maximum(density, 1e-30))).sum() * width
    np.testing.assert_allclose(d.entropy(), entropy, rtol=1e-4)


def test_independent_actions_multiply():
    both, a, b = gaussian([1.0, 2.0], [0.5, 2.0]), gaussian([1.0], [0.5]), gaussian([2.0], [2.0])
    x = jnp.array([0.2, -0.4])
    np.testing.assert_allclose(both.log_prob(x), a.log_prob(x[:1]) + b.log_prob(x[1:]), rtol=1e-6)
    np.testing.assert_allclose(both.entropy(), a.entropy() + b.entropy(), rtol=1e-6)


def test_divergence_is_the_mean_of_the_difference_of_log_densities():
    p, q = gaussian([0.3], [0.7]), gaussian([-0.2], [1.1])
    x = grid(8.0)
    log_p, log_q = jax.vmap(p.log_prob)(x), jax.vmap(q.log_prob)(x)
    expected = (jnp.exp(log_p) * (log_p - log_q)).sum() * 16.0 / 20000
    np.testing.assert_allclose(divergence(p, q), expected, rtol=1e-3)
    assert divergence(p, p) == 0


def test_tanh_density_integrates_to_one():
    """Substituting a = tanh u: the integral of p(a) is that of p(u) without the correction."""
    d = TanhGaussian(jnp.array([0.4]), jnp.log(jnp.array([0.6])))
    keys = jax.random.split(jax.random.key(0), 20000)
    action, log_prob = jax.vmap(d.sample_and_log_prob)(keys)
    assert (jnp.abs(action) < 1).all()
    # E[1 / p(a)] over samples with 0 < a < 0.5 is the length of that interval.
    inside = (action[:, 0] > 0) & (action[:, 0] < 0.5)
    np.testing.assert_allclose(jnp.where(inside, jnp.exp(-log_prob), 0).mean(), 0.5, rtol=0.03)


def test_tanh_log_density_is_finite_far_out():
    d = TanhGaussian(jnp.array([50.0]), jnp.array([0.0]))
    value, slope = jax.value_and_grad(
        lambda m: TanhGaussian(m, d.log_std).sample_and_log_prob(jax.random.key(0))[1]
    )(d.mean)
    assert np.isfinite(value)
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu", "swish"])
def test_batch_is_the_same_as_one_by_one(activation):
    network = MLP((8, 8), 3, activation, layer_norm=activation == "elu")
    obs = jax.random.normal(jax.random.key(1), (5, 4))
    params = network.init(jax.random.key(0), obs[0])
    together = network.apply(params, obs)
    one_by_one = jnp.stack([network.apply(params, x) for x in obs])
    np.testing.assert_allclose(together, one_by_one, rtol=1e-5, atol=1e-6)


def test_value_has_no_axis_of_its_own():
    network = Value((8,))
    params = network.init(jax.random.key(0), jnp.zeros(4))
    assert network.apply(params, jnp.zeros((2, 3, 4))).shape == (2, 3)


def test_squashed_policy_keeps_its_deviation_within_limits():
    network = TanhGaussianPolicy(2, (8,), min_log_std=-3.0, max_log_std=1.0, last_scale=100.0)
    params = network.init(jax.random.key(0), jnp.zeros(4))
    d = network.apply(params, 1e3 * jax.random.normal(jax.random.key(1), (50, 4)))
    assert (d.log_std >= -3).all()
    assert (d.log_std <= 1).all()


class Bounded:
    action_low = np.array([-3.0, 0.0, -np.inf])
    action_high = np.array([3.0, 0.4, np.inf])


def test_actions_fill_the_range_and_stay_in_it():
    scale = ActionRange.of(Bounded())
    np.testing.assert_allclose(scale(jnp.zeros(3)), [0, 0.2, 0])
    np.testing.assert_allclose(scale(jnp.ones(3)), [3, 0.4, 1], rtol=1e-6)
    np.testing.assert_allclose(scale(jnp.full((2, 3), -9.0)), [[-3, 0, -9]] * 2)


def test_policy_normalises_and_scales():
    network = GaussianPolicy(3, (8,))
    params = network.init(jax.random.key(0), jnp.zeros(2))
    statistics = RunningStatistics.start((2,)).update(jnp.array([[1.0, 2.0], [3.0, 6.0]]))
    policy = Policy(params, statistics, ActionRange.of(Bounded()), network)
    obs = jnp.array([3.0, 2.0])
    mean = network.apply(params, jnp.array([1.0, -1.0])).mean
    np.testing.assert_allclose(policy(obs), policy.scale(mean), rtol=1e-4)
    np.testing.assert_allclose(jax.jit(policy)(obs[None])[0], policy(obs), rtol=1e-5)
