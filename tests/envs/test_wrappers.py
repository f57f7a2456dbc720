"""Wrappers, one by one and nested."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim.envs import make
from jaxsim.envs.wrappers import (
    ActionRepeat,
    AutoReset,
    Delay,
    History,
    Noise,
    NormalizeObservation,
    NormalizeReward,
    Randomize,
    TimeLimit,
)

PUSH = jnp.ones(1)


def run(env, key, steps, action=PUSH):
    """States after each step, stacked, and the first one."""
    first = env.reset(key)

    def step(state, _):
        state = env.step(state, action)
        return state, state

    return first, jax.jit(lambda s: jax.lax.scan(step, s, length=steps)[1])(first)


def test_time_limit_truncates_unless_the_task_ends(key):
    env = TimeLimit(make("fast", max_episode_steps=None), max_episode_steps=3)
    _, states = run(env, key, 4)
    assert states.truncated.tolist() == [False, False, True, True]
    assert not states.terminated.any()
    first = env.reset(key)
    outside = first.replace(state=first.state.replace(qpos=jnp.array([2.5])))
    outside = outside.replace(info={"steps": jnp.array(2, jnp.int32)})
    last = env.step(outside, PUSH)
    assert last.terminated
    assert not last.truncated


def test_auto_reset_starts_over_and_keeps_the_last_observation(key):
    inner = make("fast", max_episode_steps=4)
    first, states = run(AutoReset(inner), key, 12)
    _, alone = run(inner, jax.random.split(key)[0], 4)
    assert states.done.tolist() == 3 * [False, False, False, True]
    # The episode's rewards and its last observation are those of the environment inside.
    np.testing.assert_allclose(states.reward[:4], alone.reward)
    np.testing.assert_allclose(states.info["terminal_obs"][3], alone.obs[3])
    assert states.info["steps"].tolist() == 3 * [1, 2, 3, 0]
    starts = np.concatenate([first.obs, states.obs[3::4, 0]])
    assert len(np.unique(starts)) == 4  # fresh ones
    assert np.abs(starts).max() <= 1
    np.testing.assert_allclose(states.obs[4], states.obs[3] + 0.1, rtol=1e-5)
    np.testing.assert_array_equal(states.info["terminal_obs"][:3], states.obs[:3])


def test_what_is_not_finite_ends_the_episode_and_stays_inside(key):
    env = AutoReset(make("fast"))
    states = jax.jit(jaxsim.vmap(env.reset))(jax.random.split(key, 3))
    actions = jnp.ones((3, 1)).at[1, 0].set(jnp.nan)
    after = jax.jit(jaxsim.vmap(env.step))(states, actions)
    assert after.terminated.tolist() == [False, True, False]
    assert after.metrics["nonfinite"].tolist() == [0, 1, 0]
    assert after.reward[1] == 0
    for leaf in jax.tree.leaves(after):
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            assert jnp.isfinite(leaf).all()
    again = jax.jit(jaxsim.vmap(env.step))(after, jnp.ones((3, 1)))
    assert not again.terminated.any()
    np.testing.assert_allclose(again.obs, after.obs + 0.1, rtol=1e-5)


def test_action_repeat_adds_rewards_until_the_end(key):
    inner = make("fast", max_episode_steps=5)
    _, plain = run(inner, key, 6)
    _, repeated = run(ActionRepeat(inner, repeats=3), key, 2)
    np.testing.assert_allclose(repeated.reward, [plain.reward[:3].sum(), plain.reward[3:5].sum()])
    np.testing.assert_allclose(repeated.obs[1], plain.obs[4])
    assert repeated.truncated.tolist() == [False, True]
    assert float(ActionRepeat(inner, repeats=3).dt) == pytest.approx(0.3)


def test_normalisation_uses_the_given_statistics(key):
    inner = make("fast")
    obs = NormalizeObservation(inner, mean=jnp.array([0.5]), std=jnp.array([0.1]), limit=3.0)
    reward = NormalizeReward(inner, std=jnp.array(0.2), limit=2.0)
    first, plain = run(inner, key, 5)
    start, states = run(obs, key, 5)
    np.testing.assert_allclose(states.obs, np.clip((plain.obs - 0.5) / 0.1, -3, 3), rtol=1e-5)
    np.testing.assert_allclose(start.obs, np.clip((first.obs - 0.5) / 0.1, -3, 3), rtol=1e-5)
    _, states = run(reward, key, 5)
    np.testing.assert_allclose(states.reward, np.clip(plain.reward / 0.2, -2, 2), rtol=1e-5)
    np.testing.assert_allclose(obs.replace(mean=first.obs).reset(key).obs, 0)


def test_history_and_delay(key):
    inner = make("fast")
    first, plain = run(inner, key, 4)
    start, states = run(History(inner, length=3), key, 4)
    x = np.concatenate([first.obs, plain.obs[:, 0]])
    np.testing.assert_allclose(start.obs, np.repeat(x[0], 3))
    np.testing.assert_allclose(states.obs[0], [x[0], x[0], x[1]])
    np.testing.assert_allclose(states.obs[3], [x[2], x[3], x[4]])
    _, late = run(Delay(inner, action=0, observation=2), key, 4)
    np.testing.assert_allclose(late.obs[:, 0], [x[0], x[0], x[1], x[2]])
    _, late = run(Delay(inner, action=2), key, 4)
    np.testing.assert_allclose(late.obs[:, 0], [x[0], x[0], x[1], x[2]])


def test_noise_has_the_given_size_and_differs(key):
    env = Noise(make("fast"), observation=0.1)
    states = jax.jit(jaxsim.vmap(env.reset))(jax.random.split(key, 1000))
    noise = states.obs - states.state.qpos
    np.testing.assert_allclose(noise.std(), 0.1, rtol=0.1)
    after = jax.jit(jaxsim.vmap(env.step))(states, jnp.zeros((1000, 1)))
    assert abs(np.corrcoef((after.obs - after.state.qpos)[:, 0], noise[:, 0])[0, 1]) < 0.1
    shaky = Noise(make("fast"), observation=0.0, action=1.0)
    _, states = run(shaky, key, 3, jnp.zeros(1))
    assert len(np.unique(states.state.qvel)) == 3


def test_randomize_draws_other_physics_in_every_episode(key):
    def slower(env, key):
        timestep = env.model.opt.timestep * jax.random.uniform(key)
        return env.with_model(env.model.replace(opt=env.model.opt.replace(timestep=timestep)))

    env = AutoReset(Randomize(make("fast", max_episode_steps=2), draw=slower))
    first, states = run(env, key, 4)
    assert list(first.info["drawn"]) == [".env.model.opt.timestep"]
    moved = np.diff(np.concatenate([first.obs, states.obs[:, 0]]))[[0, 2]]
    drawn = [float(s) for s in (first.info["drawn"][".env.model.opt.timestep"],)]
    np.testing.assert_allclose(moved[0], drawn[0], rtol=1e-4)
    assert not np.isclose(*moved)


def test_all_wrappers_nested(key):
    inner = ActionRepeat(NormalizeObservation(make("fast")))
    env = AutoReset(Noise(Delay(History(Randomize(NormalizeReward(inner)), length=2))))
    states = jax.jit(jaxsim.vmap(env.reset))(jax.random.split(key, 3))
    step = jax.jit(jaxsim.vmap(env.step))
    for _ in range(11):
        after = step(states, jnp.zeros((3, 1)))
        assert jax.tree.structure(after) == jax.tree.structure(states)
        states = after
    assert states.obs.shape == (3, env.observation_size) == (3, 2)
    assert states.info["steps"].tolist() == [2, 2, 2]  # the second episode has begun
    assert env.unwrapped is inner.unwrapped
    assert env.frame_skip == 2
