"""One episode of a policy, and its film."""

import pathlib
from typing import Any

import jax
import numpy as np

from jaxsim.envs import Env
from jaxsim.model import State
from jaxsim.viz import film

# Longest episode to show, and how long to go on when nothing moves any more (s).
LONGEST, AFTERWARDS = 20.0, 1.0
_STILL = 0.02  # of the greatest speed


def film_episode(
    env: Env, policy: Any, path: str | pathlib.Path, seed: int = 0, **options: Any
) -> pathlib.Path:
    """Play one episode and write its film, as long as there is something to see.

        result = jaxsim.rl.train("hopper")
        jaxsim.rl.film_episode(jaxsim.envs.make("hopper"), result.policy, "hopper.mp4")

    Args:
      env: the environment, without `AutoReset`.
      policy: function of an observation.
      path: file to write, see `jaxsim.viz.film`.
      seed: of the start.
      **options: further ones of `jaxsim.viz.film`.

    Returns:
      The file written.

    Raises:
      RuntimeError: no OpenGL, or imageio is not installed; the message says what to install.
    """
    trajectory = play_episode(env, policy, jax.random.key(seed))
    return film(env.unwrapped.model, trajectory, path, **options)


def play_episode(env: Env, policy: Any, key: jax.Array) -> State:
    """States (T, ...) of one episode, to its end or until nothing moves, at most 20 s."""
    steps = max(1, int(LONGEST / float(env.dt)))
    start, states, over = jax.jit(lambda key: _episode(env, key, policy, steps))(key)
    trajectory = jax.tree.map(lambda x, y: np.concatenate([x[None], y]), start, states)
    ends = np.flatnonzero(over)
    count = 2 + ends[0] if ends.size else len(over) + 1
    episode = jax.tree.map(lambda x: x[:count], trajectory)
    shown = moving_until(episode.qvel) + round(AFTERWARDS / float(env.dt))
    return jax.tree.map(lambda x: x[:shown], episode)


def moving_until(qvel: np.ndarray) -> int:
    """How many of the states (T, nv) there are up to the last that is not nearly at rest."""
    speed = np.abs(qvel).max(axis=1, initial=0)
    return 1 + int(np.flatnonzero(speed >= _STILL * speed.max())[-1])


def _episode(env: Env, key: jax.Array, policy: Any, steps: int):
    def step(state, _):
        state = env.step(state, policy(state.obs))
        return state, (state.state, state.terminated | state.truncated)

    first = env.reset(key)
    _, (states, over) = jax.lax.scan(step, first, length=steps)
    return first.state, states, over
