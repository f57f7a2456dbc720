"""A batch as a `VecEnv` of Stable-Baselines3, whose vector environments are not Gymnasium's.

One environment needs no adapter: `PPO("MlpPolicy", gymnasium.make("jaxsim/Ant-v0"))` works.

Example:
  >>> from stable_baselines3 import PPO
  >>> from jaxsim.envs.bridges.stable_baselines import vec_env
  >>> PPO("MlpPolicy", vec_env("ant", num_envs=256)).learn(1_000_000)
"""

import functools
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from jaxsim.envs.base.env import Env
from jaxsim.envs.bridges.vector import GymnasiumVectorEnv
from jaxsim.envs.registry.entries import spec


def vec_env(env: Env | str, num_envs: int = 1, **options: Any):
    """Many environments for Stable-Baselines3.

    Args:
      env: an environment, or the name of a registered one, with its default time limit.
      num_envs: number of environments.
      **options: arguments of `GymnasiumVectorEnv`, for instance fields of the environment.

    Returns:
      A `stable_baselines3.common.vec_env.VecEnv`.

    Raises:
      ModuleNotFoundError: Stable-Baselines3 is not installed.
    """
    if isinstance(env, str):
        options.setdefault("max_episode_steps", spec(env).max_episode_steps)
    options["autoreset_mode"] = AutoresetMode.SAME_STEP
    return _vec_env_class()(GymnasiumVectorEnv(env, num_envs, **options))


@functools.cache
def _vec_env_class() -> type:
    try:
        from stable_baselines3.common.vec_env import (  # pyright: ignore[reportMissingImports]
            VecEnv,
        )
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "this bridge needs Stable-Baselines3, which jaxsim does not install: "
            "pip install stable-baselines3"
        ) from error

    return type("JaxsimVecEnv", (_Methods, VecEnv), {"__doc__": _Methods.__doc__})


class _Methods:
    """Environments of jaxsim for Stable-Baselines3; `envs` is the vector environment inside."""

    num_envs: int
    _seeds: list[int | None]

    def __init__(self, envs: GymnasiumVectorEnv):
        self.envs, self._actions = envs, None
        base: Any = super()
        base.__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> np.ndarray:
        seeds = self._seeds if any(s is not None for s in self._seeds) else None
        obs, info = self.envs.reset(seed=seeds)
        self.reset_infos = [_of_one(info, i) for i in range(self.num_envs)]
        self._seeds = [None] * self.num_envs
        self._options = [{} for _ in range(self.num_envs)]
        return obs

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self):
        obs, reward, terminated, truncated, info = self.envs.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(terminated | truncated).tolist():
            infos[i] = _of_one(info["final_info"], i)
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        return obs, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        self.envs.close()

    def get_images(self):
        return list(self.envs.render() or [None] * self.num_envs)

    def get_attr(self, attr_name: str, indices=None) -> list[Any]:
        return [getattr(self.envs, attr_name) for _ in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:
        raise AttributeError(
            f"the environments of a batch are compiled, {attr_name!r} cannot be set: give options "
            "to vec_env instead"
        )

    def env_method(self, method_name: str, *args: Any, indices=None, **kwargs: Any) -> list[Any]:
        if len(list(self._chosen(indices))) < self.num_envs:
            raise ValueError("the environments of a batch act together: leave out `indices`")
        result = getattr(self.envs, method_name)(*args, **kwargs)
        return [result] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices=None) -> list[bool]:
        return [False for _ in self._chosen(indices)]

    def _chosen(self, indices):
        if indices is None:
            return range(self.num_envs)
        return [indices] if isinstance(indices, int) else indices


def _of_one(info: dict[str, Any], i: int) -> dict[str, Any]:
    """The entries of one environment, from Gymnasium's vector format."""
    names = [name for name in info if not name.startswith("_") and info[f"_{name}"][i]]
    return {name: info[name][i] for name in names}
