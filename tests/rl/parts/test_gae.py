"""Advantages: numbers worked by hand, and the limits of lambda."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.rl.parts.gae import advantages

REWARD = jnp.array([1.0, 2.0, 3.0])
VALUE = jnp.array([0.5, 1.0, 1.5])
NEXT = jnp.array([1.0, 1.5, 4.0])
NEVER = jnp.zeros(3, bool)


def flags(*steps):
    return NEVER.at[jnp.array(steps)].set(True)


def test_by_hand():
    """delta = (1 + 0.5 - 0.5, 2 + 0.75 - 1, 3 + 2 - 1.5); each next one counts a quarter."""
    got = advantages(REWARD, VALUE, NEXT, NEVER, NEVER, 0.5, 0.5)
    np.testing.assert_allclose(got, [1 + 0.25 * (1.75 + 0.25 * 3.5), 1.75 + 0.25 * 3.5, 3.5])


def test_termination_ends_the_return():
    """The value after the end counts nothing: delta_1 = 2 - 1, and nothing is carried over it."""
    got = advantages(REWARD, VALUE, NEXT, flags(1), NEVER, 0.5, 0.5)
    np.testing.assert_allclose(got, [1 + 0.25 * 1, 1, 3.5])


def test_truncation_keeps_the_value_and_stops_the_sum():
    got = advantages(REWARD, VALUE, NEXT, NEVER, flags(1), 0.5, 0.5)
    np.testing.assert_allclose(got, [1 + 0.25 * 1.75, 1.75, 3.5])


def test_a_value_that_is_not_finite_after_the_end_is_not_seen():
    got = advantages(REWARD, VALUE, NEXT.at[1].set(jnp.nan), flags(1), NEVER, 0.5, 0.5)
    np.testing.assert_allclose(got, [1.25, 1, 3.5])


def test_decay_zero_is_one_step():
    got = advantages(REWARD, VALUE, NEXT, NEVER, NEVER, 0.9, 0.0)
    np.testing.assert_allclose(got, REWARD + 0.9 * NEXT - VALUE, rtol=1e-6)


@pytest.mark.parametrize("ends", [(), (1,), (0, 2)])
def test_decay_one_is_the_return_less_the_value(rng, ends):
    """With lambda = 1 the values in between cancel, provided V(s'_t) = V(s_{t+1})."""
    value = jnp.asarray(rng.normal(size=4), jnp.float32)
    done = np.isin(np.arange(3), ends)
    got = advantages(REWARD, value[:3], value[1:], jnp.asarray(done), NEVER, 0.9, 1.0)
    expected, after = [], float(value[3])
    for t in (2, 1, 0):
        after = float(REWARD[t]) + 0.9 * (0.0 if done[t] else after)
        expected.insert(0, after - float(value[t]))
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)
