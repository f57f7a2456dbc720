"""A clock of few digits: it neither drifts nor stands still."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.arrays.running_sum import add_rounding_up


@pytest.mark.parametrize("start", [0.0, 0.9999, 2048.0, 1e5])
def test_the_sum_is_exact_to_its_last_place(start):
    term, steps = np.float32(1e-4), 20_000

    def add(carry, _):
        after = add_rounding_up(*carry, term)
        return after, after

    zero = jnp.float32(0)
    _, found = jax.lax.scan(add, (jnp.float32(start), zero), None, length=steps)
    total, excess = np.asarray(found, float)
    exact = float(np.float32(start)) + float(term) * np.arange(1, steps + 1)
    unit = np.spacing(total.astype(np.float32))
    assert total[0] > np.float32(start)
    assert (np.diff(total) >= 0).all()
    np.testing.assert_allclose(total - excess, exact, rtol=0, atol=1e-3 * unit.max())
    assert (total >= exact - 1e-3 * unit).all()
    assert (total <= exact + 1.001 * unit).all()


def test_a_total_that_was_set_is_exact():
    total, excess = add_rounding_up(jnp.float32(2048), jnp.float32(0), jnp.float32(1e-4))
    assert excess > 1e-4
    after, _ = add_rounding_up(jnp.float32(0), excess, jnp.float32(1e-4))
    assert after == np.float32(1e-4)
    assert total > 2048


def test_its_derivative_is_that_of_a_sum():
    after = lambda total, term: add_rounding_up(total, jnp.float32(1e-9), term)[0]  # noqa: E731
    slopes = jax.grad(after, argnums=(0, 1))(jnp.float32(3), jnp.float32(0.1))
    assert slopes == (1, 1)
