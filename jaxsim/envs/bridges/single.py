"""`gymnasium.make("jaxsim/Ant-v0")`: one environment behind Gymnasium's `Env`."""

import functools
from typing import Any, ClassVar

import gymnasium
import jax
import numpy as np

from jaxsim.envs.base import Env, EnvState
from jaxsim.envs.bridges import batch, render, spaces
from jaxsim.envs.registry import make
from jaxsim.parallel.devices import compiled


class GymnasiumEnv(gymnasium.Env):
    """One environment with Gymnasium's interface; the simulation is compiled.

    For training take `gymnasium.make_vec`: it simulates thousands for little more than the
    overhead of one.

    Attributes:
      env: the environment of `jaxsim.envs` behind this one.
      state: its `EnvState`; None before the first reset.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 50}

    def __init__(
        self,
        env: Env | str,
        *,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: int | str | None = None,
        **options: Any,
    ):
        """Wrap an environment, or make one.

        Args:
          env: an environment, or the name of a registered one, made without a time limit.
          render_mode: "rgb_array" or None.
          width: of rendered frames, in pixels.
          height: of rendered frames, in pixels.
          camera: name or number of a camera; -1 for a free one; by default the one called "track".
          **options: the fields of the environment, where it is given by name.
        """
        self.env = make(env, max_episode_steps=None, **options) if isinstance(env, str) else env
        self.render_mode = render.checked_mode(render_mode)
        self.metadata = {**self.metadata, "render_fps": round(1 / float(self.env.dt))}
        self.observation_space = spaces.observation_space(self.env)
        self.action_space = spaces.action_space(self.env)
        self.state: EnvState | None = None
        self._key = None
        self._frames = render.frames(self.env, width, height, camera) if render_mode else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode.

        Args:
          seed: start of the sequence of random episodes; None continues it.
          options: not used.

        Returns:
          The observation and the infos.
        """
        super().reset(seed=seed)
        if seed is not None or self._key is None:
            entropy = int(self.np_random.integers(2**32)) if seed is None else seed
            self._key = batch.root_keys([entropy])[0]
        state, self._key = _restart(self.env, self._key)
        self.state = state
        return np.array(state.obs), _info(state)

    def step(self, action):
        """Advance by one step of control.

        Args:
          action: controls, of the action space's shape.

        Returns:
          Observation, reward, whether the task ended, whether time is up, and the infos.

        Raises:
          gymnasium.error.ResetNeeded: `reset` was never called.
        """
        if self.state is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        action = np.asarray(action, np.float32).reshape(self.action_space.shape)
        s = _step(self.env, self.state, action)
        self.state = s
        outcome = float(s.reward), bool(s.terminated), bool(s.truncated)
        return np.array(s.obs), *outcome, _info(s)

    def render(self) -> np.ndarray | None:
        """The frame as an array (height, width, 3), or None without a render mode."""
        if self._frames is None or self.state is None:
            return None
        return self._frames.frame(self.state.state)

    def close(self) -> None:
        """Free the renderer."""
        if self._frames is not None:
            self._frames.close()


def _info(state: EnvState) -> dict[str, Any]:
    info = jax.device_get(spaces.public_info(state))
    return {k: v.item() if v.ndim == 0 else np.array(v) for k, v in info.items()}


@functools.cache
def _compiled(f):
    return compiled(f, jax.default_backend())


def _restart(env, key):
    return _compiled(batch.restart)(env, key)


def _step(env, state, action):
    return _compiled(batch.guarded_step)(env, state, action)
