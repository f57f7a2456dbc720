"""Steps of Adam, minibatches, and numbers that must not reach the parameters."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxsim.rl.config import ConfigError
from jaxsim.rl.parts.descent import Adam, blend, check_minibatches, keep_finite, minibatches

PARAMS = {"w": jnp.array([1.0, -2.0]), "b": jnp.array(0.5)}


def test_adam_is_that_of_optax():
    ours, theirs = Adam(1.0, (0.7, 0.95)), optax.adam(0.1, 0.7, 0.95)
    state, reference = ours.init(PARAMS), theirs.init(PARAMS)
    mine, other = PARAMS, PARAMS
    for scale in (0.1, -0.3, 0.2):
        gradient = jax.tree.map(lambda x, s=scale: s * x, PARAMS)  # shorter than the limit
        mine, state = ours.step(mine, state, gradient, 0.1)
        step, reference = theirs.update(gradient, reference)
        other = optax.apply_updates(other, step)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6), mine, other)


def test_adam_scales_long_gradients_down():
    """The first moment after one step is (1 - beta_1) times the gradient that was used."""
    adam = Adam(1.0, (0.0, 0.0))
    gradient = {"w": jnp.array([300.0, 400.0]), "b": jnp.array(0.0)}
    _, state = adam.step(PARAMS, adam.init(PARAMS), gradient, 0.1)
    moments = [x for x in jax.tree.leaves(state) if x.ndim == 1]
    np.testing.assert_allclose(np.sort(moments[0]), [0.0, 0.6, 0.8], rtol=1e-6)


@pytest.mark.parametrize("bad", [jnp.nan, jnp.inf])
def test_keep_finite(bad):
    old, new = PARAMS, jax.tree.map(lambda x: x + 1, PARAMS)
    watched = {"loss": jnp.array(0.0), "gradient": jnp.array([1.0, 2.0])}
    fine = keep_finite(watched, new, old)
    jax.tree.map(np.testing.assert_array_equal, fine, new)
    watched["gradient"] = jnp.array([1.0, bad])
    jax.tree.map(np.testing.assert_array_equal, keep_finite(watched, new, old), old)


def test_each_pass_takes_every_sample_once():
    order = np.array(minibatches(jax.random.key(0), 12, 3, 4))
    assert order.shape == (12, 3)
    passes = order.reshape(3, 12)
    np.testing.assert_array_equal(np.sort(passes, axis=1), np.tile(np.arange(12), (3, 1)))
    assert (passes[0] != passes[1]).any()


def test_minibatches_of_one_size():
    check_minibatches(12, 4, "steps")
    with pytest.raises(ConfigError, match=r"steps on each device \(12\) .* minibatches \(5\)"):
        check_minibatches(12, 5, "steps")


def test_blend():
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, 1.25 * y),
        blend(PARAMS, jax.tree.map(lambda x: 2 * x, PARAMS), 0.25),
        PARAMS,
    )
