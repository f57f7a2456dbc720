"""Running statistics: equal to those of all samples at once, on any number of devices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import PartitionSpec
from oracle import quick_jit

from jaxsim.parallel.devices import AXIS, device_mesh, parallel
from jaxsim.rl.normalize import RunningStatistics, discounted_returns


def test_batches_add_up_to_all_samples(rng):
    samples = (3 + 2 * rng.normal(size=(60, 4))).astype(np.float32)
    statistics = RunningStatistics.start((4,))
    for part in (samples[:10], samples[10:15], samples[15:]):
        statistics = statistics.update(jnp.asarray(part))
    assert statistics.count == 60
    np.testing.assert_allclose(statistics.mean, samples.mean(0), rtol=1e-5)
    np.testing.assert_allclose(statistics.variance, samples.var(0), rtol=1e-4)


def test_devices_see_the_samples_of_all(rng):
    samples = jnp.asarray(rng.normal(size=(16, 3)), jnp.float32)
    start = RunningStatistics.start((3,)).update(samples[:4])
    mesh = device_mesh()
    assert mesh.size == 2
    everywhere = PartitionSpec()
    update = parallel(
        lambda s, x: s.update(x, AXIS), mesh, (everywhere, PartitionSpec(AXIS)), everywhere
    )
    for got, expected in zip(
        jax.tree.leaves(update(start, samples)), jax.tree.leaves(start.update(samples)), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)


def test_large_offset_keeps_its_precision(rng):
    """E[x^2] - E[x]^2 would lose everything here."""
    samples = (1e4 + rng.normal(size=(1000, 1))).astype(np.float32)
    statistics = RunningStatistics.start((1,)).update(jnp.asarray(samples))
    np.testing.assert_allclose(statistics.variance, samples.astype(float).var(0), rtol=1e-2)


def test_samples_that_are_not_finite_do_no_harm():
    statistics = RunningStatistics.start((1,)).update(jnp.array([[1.0], [3.0]]))
    after = statistics.update(jnp.array([[jnp.nan], [jnp.inf]]))
    np.testing.assert_allclose(after.mean, 2)
    assert np.isfinite(after.variance).all()


@pytest.mark.parametrize("value", [1e12, -1e20, 3e38, np.inf, np.nan])
@pytest.mark.parametrize("when", [0, 1, 20])
def test_one_wild_sample_does_no_lasting_harm(rng, value, when):
    """One in 128 of one batch: after 100 batches the others are still told apart."""
    statistics, update = RunningStatistics.start((2,)), quick_jit(RunningStatistics.update)
    scale = np.array([1.0, 1e3], np.float32)
    for batch in range(100):
        samples = 5 + scale * rng.normal(size=(128, 2)).astype(np.float32)
        samples[7, :] = np.where(batch == when, value, samples[7, :])
        statistics = update(statistics, jnp.asarray(samples))
    np.testing.assert_array_less(np.abs(statistics.mean - 5), 0.5 * scale)
    np.testing.assert_array_less(np.abs(np.log2(statistics.variance / scale**2)), 1.0)


def test_what_all_samples_do_is_followed(rng):
    """From nothing to a thousand, as a force does when first it touches: no limit holds it back."""
    statistics, update = RunningStatistics.start((1,)), quick_jit(RunningStatistics.update)
    for batch in range(60):
        touched = 1e3 * (rng.random(size=(256, 1)) < 0.05) * (batch > 20)
        statistics = update(statistics, jnp.asarray(touched, jnp.float32))
    expected = 1e3 * np.sqrt(0.05 * 40 / 60)
    assert 0.5 * expected < np.sqrt(statistics.variance[0]) < expected


def test_normalize_gives_mean_zero_and_deviation_one(rng):
    samples = jnp.asarray(5 + 3 * rng.normal(size=(500, 2)), jnp.float32)
    normal = RunningStatistics.start((2,)).update(samples).normalize(samples)
    np.testing.assert_allclose(normal.mean(0), 0, atol=1e-4)
    np.testing.assert_allclose(normal.std(0), 1, rtol=1e-3)
    constant = RunningStatistics.start((1,)).update(jnp.ones((5, 1)))
    assert constant.normalize(jnp.ones(1)) == 0
    assert constant.normalize(jnp.array([1e9])) == 10


def test_discounted_returns_start_again_after_an_episode():
    reward = jnp.array([[1.0], [2.0], [4.0]])
    done = jnp.array([[False], [True], [False]])
    after, g = discounted_returns(jnp.array([8.0]), reward, done, 0.5)
    np.testing.assert_allclose(g[:, 0], [1 + 4, 2 + 2.5, 4])
    np.testing.assert_allclose(after, [4])
    assert discounted_returns(jnp.array([8.0]), reward, done | True, 0.5)[0] == 0
