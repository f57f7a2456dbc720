"""The quadruped: stands by itself, is told where to go, is paid for going there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.quadruped import Quadruped

STEPS = 60


@pytest.fixture(scope="module")
def env():
    return Quadruped(command_period=0.5)


@pytest.fixture(scope="module")
def episode(env):
    """States of two robots: one does nothing, the other folds its legs."""

    def run(key, fold):
        def body(state, _):
            action = fold * jnp.tile(jnp.asarray([0.0, 1.0, 1.0]), 4)
            state = env.step(state, action)
            return state, state

        first = env.reset(key)
        states = jax.lax.scan(body, first, length=STEPS)[1]
        return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, states)

    keys = jax.random.split(jax.random.key(3))
    return quick_jit(jax.vmap(run))(keys, jnp.asarray([0.0, 1.0]))


def test_it_stands_without_being_told_how(episode):
    assert not episode.terminated[0].any()
    np.testing.assert_allclose(episode.state.qpos[0, -1, 2], 0.31, atol=0.02)
    np.testing.assert_allclose(episode.obs[0, -1, 6:9], [0, 0, -1], atol=0.05)


def test_observation_is_in_the_axes_of_the_trunk(episode):
    """Whatever the heading, from the state alone."""
    each = (episode.obs[1], episode.state.qpos[1], episode.state.qvel[1])
    for obs, qpos, qvel in zip(*map(np.asarray, each), strict=True):
        w, x, y, z = qpos[3:7]
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        np.testing.assert_allclose(obs[:3], R.T @ qvel[:3], atol=1e-5)
        np.testing.assert_allclose(obs[6:9], -R[2], atol=1e-5)


def test_commands_change_on_time_and_stay_in_range(env, episode):
    commands = np.asarray(episode.info["command"])
    period = round(0.5 / float(env.dt))
    changed = np.abs(np.diff(commands, axis=1)).max(-1) > 0
    expected = np.zeros(STEPS, bool)
    expected[period - 1 :: period] = True
    np.testing.assert_array_equal(changed, np.stack([expected, expected]))
    assert (np.abs(commands) <= np.asarray(env.command_range)).all()
    assert np.abs(commands[0] - commands[1]).max() > 0.1
    np.testing.assert_array_equal(episode.obs[..., 9:12], commands)


def test_reward_is_the_sum_of_its_terms_and_tracks_the_command_that_was_seen(env, episode):
    total = sum(v for k, v in episode.metrics.items() if k.startswith("reward_"))
    np.testing.assert_allclose(episode.reward, total, rtol=1e-5, atol=1e-6)
    seen = np.asarray(episode.info["command"])[:, :-1]
    error = np.asarray(episode.obs)[:, 1:, :2] - seen[..., :2]
    expected = np.exp(-(error**2).sum(-1) / env.tracking_width)
    np.testing.assert_allclose(episode.metrics["reward_velocity"][:, 1:], expected, rtol=1e-3)


def test_falling_ends_the_episode(env):
    state = env.start(jax.random.key(0))
    nothing = jnp.zeros(12)

    def terminated(qpos):
        there = state.replace(qpos=qpos)
        return bool(env.terminated(Moment(env.model, there, there, nothing, nothing, {})))

    assert not terminated(state.qpos)
    for height, roll in ((0.1, 0.0), (0.6, 2.0)):
        quat = jnp.asarray([np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0])
        assert terminated(state.qpos.at[2].set(height).at[3:7].set(quat))


def test_actions_are_offsets_of_the_servos(env):
    np.testing.assert_array_equal(env.action_high, np.ones(12))
    np.testing.assert_array_equal(env.action_low, -np.ones(12))
    np.testing.assert_allclose(env.control(jnp.full(12, 3.0)), env.action_scale)


def test_a_batch_and_its_command_keys():
    env = jaxsim.envs.make("quadruped")
    states = jax.eval_shape(jaxsim.vmap(env.reset), jax.random.split(jax.random.key(0), 5))
    after = jax.eval_shape(jaxsim.vmap(env.step), states, jnp.zeros((5, 12)))
    assert jax.tree.map(jnp.shape, after) == jax.tree.map(jnp.shape, states)
