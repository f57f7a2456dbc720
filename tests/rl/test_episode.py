"""Episodes for films: from the start to the end, without what stands still."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim import envs
from jaxsim.rl.episode import AFTERWARDS, moving_until, play_episode


def test_rest_is_left_out():
    qvel = np.array([[0.0, 1.0], [3.0, 0.0], [0.01, 0.0], [0.0, 0.02]])
    assert moving_until(qvel) == 2
    assert moving_until(np.zeros((4, 2))) == 4
    assert moving_until(np.zeros((4, 0))) == 4


def test_an_episode_ends_where_the_task_does():
    env = envs.make("fast", max_episode_steps=7)
    states = play_episode(env, lambda obs: jnp.ones(env.action_size), jax.random.key(0))
    assert states.qpos.shape[0] == 8
    np.testing.assert_allclose(np.diff(states.time), float(env.dt), rtol=1e-4)
    assert AFTERWARDS > 0
