"""Evaluation counts whole episodes, from a fresh start to the step that ends them."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim import envs
from jaxsim.envs.wrappers import ActionRepeat
from jaxsim.rl import evaluate

KEYS = jax.random.split(jax.random.key(5), 6)


def away(obs):
    """At full speed to where the episode terminates."""
    return jnp.where(obs > 0, 1.0, -1.0)


def one_by_one(env, policy, key):
    state, total, steps = env.reset(key), 0.0, 0
    while not bool(state.done):
        state = env.step(state, policy(state.obs))
        total, steps = total + float(state.reward), steps + 1
    return total, steps


def test_agrees_with_a_plain_loop():
    env = envs.make("fast")
    result = jax.jit(lambda keys: evaluate(env, away, keys, 1000))(KEYS)
    expected = [one_by_one(env, away, key) for key in KEYS]
    np.testing.assert_allclose(result.returns, [r for r, _ in expected], rtol=1e-4)
    np.testing.assert_array_equal(result.lengths, [n for _, n in expected])
    assert len(set(np.asarray(result.lengths))) > 1


def test_time_limit_of_the_environment_and_of_the_call():
    still = jnp.zeros_like
    assert (evaluate(envs.make("fast"), still, KEYS, 1000).lengths == 20).all()
    assert (evaluate(envs.make("fast"), still, KEYS, 7).lengths == 7).all()
    assert (evaluate(envs.make("fast"), still, KEYS).lengths == 20).all()
    assert (evaluate(envs.make("fast", max_episode_steps=1005), still, KEYS).lengths == 1005).all()
    endless = envs.make("fast", max_episode_steps=None)
    assert (evaluate(endless, still, KEYS, 30).lengths == 30).all()


def test_the_limit_of_nested_environments():
    env = envs.make("fast", max_episode_steps=7)
    assert env.unwrapped.episode_limit is None
    assert envs.Wrapper(env).episode_limit == 7
    assert envs.TimeLimit(env, max_episode_steps=9).episode_limit == 7
    assert ActionRepeat(env, repeats=2).episode_limit == 4
    repeated = ActionRepeat(env, repeats=2)
    assert (evaluate(repeated, jnp.zeros_like, KEYS).lengths == 4).all()


def test_numbers_that_are_not_finite_end_an_episode():
    result = evaluate(envs.make("fast"), lambda obs: jnp.full_like(obs, jnp.nan), KEYS, 1000)
    np.testing.assert_array_equal(result.returns, 0)
    np.testing.assert_array_equal(result.lengths, 1)


def test_metrics_summarise():
    result = evaluate(envs.make("fast"), away, KEYS, 1000)
    metrics = result.metrics()
    np.testing.assert_allclose(metrics["eval_return"], result.returns.mean(), rtol=1e-6)
    np.testing.assert_allclose(metrics["eval_return_min"], result.returns.min(), rtol=1e-6)
