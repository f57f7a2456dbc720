"""`gymnasium.make("jaxsim/Ant-v0")`: one environment behind Gymnasium's `Env`."""

import functools
from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium
import jax
import numpy as np

from jaxsim.envs.base.env import Env, EnvState
from jaxsim.envs.bridges import batch, packing, render, spaces
from jaxsim.envs.bridges.constant import Constant, programs_of
from jaxsim.envs.bridges.documented import documented
from jaxsim.envs.bridges.fork import check_fork
from jaxsim.envs.bridges.words import Words
from jaxsim.envs.registry.entries import make
from jaxsim.lanes import as_kernel
from jaxsim.lanes.switch import lanes_for_one
from jaxsim.parallel.devices import compiled


class GymnasiumEnv(gymnasium.Env):
    """One environment with Gymnasium's interface; the simulation is compiled.

    For training, use `gymnasium.make_vec`: thousands of environments take little more time than
    one.
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
          width: width of rendered frames in pixels.
          height: height of rendered frames in pixels.
          camera: name or number of a camera; -1 for a free camera; by default the one called
            "track".
          **options: the fields of the environment, where it is given by name.
        """
        self._given, self._options = env, options
        self._constant: Constant | None = None
        known = documented(env, options)
        self.render_mode = render.checked_mode(render_mode)
        dt = self.env.dt if known is None else known.dt
        self.metadata = {**self.metadata, "render_fps": round(1 / float(dt))}
        self.observation_space = (
            spaces.observation_space(self.env) if known is None else known.observation_space
        )
        self.action_space = spaces.action_space(self.env) if known is None else known.action_space
        self._layout: Words | None = None
        self._words: jax.Array | None = None
        self._program: tuple[Callable, packing.Results] | None = None
        self._key = None
        self._frames = render.frames(self.env, width, height, camera) if render_mode else None

    @property
    def env(self) -> Env:
        """The environment of `jaxsim.envs` behind this one; a bundled one is made when needed."""
        return self._placed.value

    @env.setter
    def env(self, env: Env) -> None:
        self._constant, self._program = Constant(env), None

    @property
    def state(self) -> EnvState | None:
        """The `EnvState`; None before the first reset. Another one can be assigned."""
        if self._layout is None or self._words is None:
            return None
        return self._layout.unpacked(self._words)

    @state.setter
    def state(self, state: EnvState) -> None:
        self._layout, self._program = Words.of(state), None
        self._words = self._layout.packed(state)

    @property
    def _placed(self) -> Constant:
        if self._constant is None:
            check_fork()
            env = self._given
            if isinstance(env, str):
                env = make(env, max_episode_steps=None, **self._options)
            batch.check_single(env)
            self._constant = Constant(env)
        return self._constant

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode.

        Args:
          seed: seed of the sequence of random episodes; None continues the sequence.
          options: not used.

        Returns:
          The observation and the infos.

        Raises:
          RuntimeError: this process was forked after JAX had started.
        """
        check_fork()
        super().reset(seed=seed)
        if seed is not None or self._key is None:
            entropy = int(self.np_random.integers(2**32)) if seed is None else seed
            self._key = batch.root_keys([entropy])[0]
        restart, self._layout = _restart(self._placed)
        self._words, self._key = restart(self._key)
        _, results = self._program = _step(self._placed, self._layout)
        obs, _, _, _, info = results.read(np.asarray(self._words))
        return obs, info

    def step(self, action):
        """Advance by one step of control.

        Args:
          action: controls, of the action space's shape.

        Returns:
          Observation, reward, terminated, truncated, and the infos.

        Raises:
          gymnasium.error.ResetNeeded: `reset` was never called.
          RuntimeError: this process was forked after JAX had started.
        """
        check_fork()
        if self._layout is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        action = np.asarray(action, np.float32).reshape(self.action_space.shape)
        step, results = self._program = self._program or _step(self._placed, self._layout)
        self._words = step(self._words, action)
        return results.read(np.asarray(self._words))

    def render(self) -> np.ndarray | None:
        """The frame as an array (height, width, 3), or None without a render mode."""
        if self._frames is None or (now := self.state) is None:
            return None
        return self._frames.frame(now.state)

    def close(self) -> None:
        """Free the renderer."""
        if self._frames is not None:
            self._frames.close()


@programs_of
def _restart(constant: Constant) -> tuple[Callable, Words]:
    """The compiled function `key -> (words, key)`, and what the words mean."""
    begin = functools.partial(batch.restart, constant.value)
    layout = Words.of(jax.eval_shape(begin, jax.random.key(0))[0])

    def restart(key):
        state, key = begin(key)
        return layout.packed(state), key

    return compiled(restart, jax.default_backend()), layout


@programs_of
def _step(constant: Constant, layout: Words) -> tuple[Callable, packing.Results]:
    """The compiled function `(words, action) -> words`, and how results are read from these."""
    advance = functools.partial(batch.guarded_step, constant.value)

    def step(words, action):
        return layout.packed(advance(layout.unpacked(words), action))

    if lanes_for_one():
        step = as_kernel(step)

    return compiled(step, jax.default_backend()), packing.Results(layout)
