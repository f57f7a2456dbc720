"""APG: its gradient is that of the truncated returns, and it learns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim import envs
from jaxsim.rl import apg, config, train
from jaxsim.rl.apg import APG, truncated_return
from jaxsim.rl.config import ConfigError

TINY = {
    "envs": 4,
    "unroll": 6,
    "horizon": 3,
    "evaluation_episodes": 4,
    "policy": {"hidden": [8]},
}


def test_return_by_hand():
    """1 + .5 * 2, and from the next episode 3 + .5 * 4."""
    done = jnp.array([False, True, False, False])
    got = truncated_return(jnp.array([1.0, 2.0, 3.0, 4.0]), done, 0.5)
    np.testing.assert_allclose(got, 7.0)


def build(**changes):
    """APG on `fast` with tiny settings, a learner, and environments."""
    env = envs.AutoReset(envs.make("fast", max_episode_steps=4))
    trainer = APG(env, config.build(apg.Config, TINY | changes))
    learner = jax.jit(trainer.init)(jax.random.key(0))
    keys = jax.random.split(jax.random.key(1), 4)
    return trainer, learner, jax.jit(trainer.start)(learner, keys)


def test_gradient_is_cut_after_the_horizon(monkeypatch):
    """Two horizons in a row are as good as two rollouts, the second from where the first ended."""
    # The same random numbers in every step, however the rollout is divided.
    monkeypatch.setattr(jax.random, "split", lambda key, num=2: jnp.broadcast_to(key, (num,)))
    two, learner, actors = build()
    one, _, _ = build(unroll=3)
    gradient = lambda trainer: jax.jit(jax.grad(trainer.loss, has_aux=True))  # noqa: E731
    key = jax.random.key(2)
    got, _ = gradient(two)(learner.params, learner, actors, key)
    total, separate = None, gradient(one)
    for _ in range(2):
        found, (actors, *_) = separate(learner.params, learner, actors, key)
        total = found if total is None else jax.tree.map(jnp.add, total, found)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b / 2, rtol=1e-4), got, total)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"envs": 7}, "envs must be a multiple of the 2 devices, got 7"),
        ({"horizon": 4}, r"unroll must be a multiple of horizon \(4\), got 6"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    with pytest.raises(ConfigError, match=message):
        train("fast", "apg", settings=TINY | settings)


def test_learns():
    """To stay in the middle earns 20, doing nothing about 13, leaving it much less."""
    settings = TINY | {"total_steps": 100 * 96, "envs": 16, "evaluations": 1, "learning_rate": 1e-2}
    result = train("fast", "apg", settings=settings)
    assert result.evaluations[-1]["eval_return"] > 18
