"""Gradients through environments: bounded, confined to one environment, cut at resets."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxsim
from jaxsim import envs
from jaxsim.rl.parts.collect import start_actors
from jaxsim.rl.parts.differentiable import (
    Differentiable,
    cut_episodes,
    discounts,
    spread_episodes,
)


def test_discounts_begin_anew_with_an_episode():
    done = jnp.array([False, False, True, False, True, False])
    np.testing.assert_allclose(discounts(done, 0.5), [1, 0.5, 0.25, 1, 0.5, 1])


def test_steps_are_those_of_the_environment():
    env = envs.AutoReset(envs.make("fast"))
    state, action = env.reset(jax.random.key(0)), jnp.array([0.3])
    plain, through = env.step(state, action), Differentiable(env).step(state, action)
    np.testing.assert_array_equal(plain.obs, through.obs)
    np.testing.assert_array_equal(plain.reward, through.reward)


def test_no_gradient_crosses_a_reset():
    env = Differentiable(envs.AutoReset(envs.make("fast", max_episode_steps=2)))
    state = env.reset(jax.random.key(0))

    def positions(action):
        before = env.step(state, action)
        after = env.step(before, action)
        return before.obs[0], after.info["terminal_obs"][0], after.obs[0]

    slopes = jax.jacobian(positions)(jnp.array([0.1]))
    np.testing.assert_allclose(np.concatenate(slopes), [0.1, 0.2, 0.0], rtol=1e-6)


def test_training_cuts_and_spreads_episodes():
    env = cut_episodes(envs.AutoReset(envs.make("fast")), 5)
    keys = jax.random.split(jax.random.key(0), 64)
    actors = spread_episodes(start_actors(env, keys), keys, 5)
    assert set(np.asarray(actors.env.info["steps"])) == {0, 1, 2, 3, 4}
    after = jaxsim.vmap(env.step)(actors.env, jnp.zeros((64, 1)))
    np.testing.assert_array_equal(after.truncated, actors.env.info["steps"] == 4)
    assert cut_episodes(env, None) is env
    assert spread_episodes(actors, keys, None) is actors
