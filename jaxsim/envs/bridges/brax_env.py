"""Adapter with Brax's interface, so that Brax's trainers can be used.

Example:
  >>> from brax.training.agents.ppo import train as ppo
  >>> from jaxsim.envs.bridges.brax_env import BraxEnv, wrap_for_brax
  >>> ppo.train(BraxEnv("ant"), num_timesteps=10_000_000, wrap_env_fn=wrap_for_brax)
"""

import functools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.batching import vmap
from jaxsim.envs.base.env import Env, EnvState
from jaxsim.envs.bridges.batch import guarded_step
from jaxsim.envs.registry.entries import make
from jaxsim.model import Model

_COUNTER = "steps"  # what Brax's EpisodeWrapper adds to `info`


@struct.dataclass
class BraxState:
    """The fields of `brax.envs.State`.

    Attributes:
      pipeline_state: the whole `EnvState`.
      obs: the observation.
      reward: reward of the last step.
      done: 1 if the episode has ended, for either reason.
      metrics: terms of the reward; entries of Brax's wrappers are kept.
      info: `truncation` is 1 if the episode was truncated; entries of wrappers are kept.
    """

    pipeline_state: EnvState
    obs: Float[Array, "n"]
    reward: Float[Array, ""]
    done: Float[Array, ""]
    metrics: dict[str, Array]
    info: dict[str, Any]


class BraxEnv:
    """One environment with the methods and properties of `brax.envs.Env`.

    Brax's trainers batch, truncate and restart episodes themselves, so an environment that is given
    by name has no time limit; `episode_length` is the trainer's argument. If an environment has a
    limit, `wrap_for_brax` keeps it. Brax's own wrappers would treat such a truncation as a
    termination, so with them only `episode_length` counts.

    A step that has `diverged` ends the episode, as in the other bridges: `metrics["nonfinite"]` is
    then 1, and the other numbers are discarded.
    """

    def __init__(self, env: Env | str, **options: Any):
        """Wrap an environment, or make one.

        Args:
          env: an environment, or the name of a registered one.
          **options: the fields of the environment, where it is given by name.
        """
        self.env = make(env, max_episode_steps=None, **options) if isinstance(env, str) else env

    def reset(self, rng: Array) -> BraxState:
        """Start an episode; `rng` is a key of either of JAX's kinds."""
        state = self.env.reset(rng)
        metrics = {**state.metrics, "nonfinite": jnp.zeros_like(state.reward)}
        return _brax_state(state.replace(metrics=metrics), {}, {}, state.done)

    def step(self, state: BraxState, action: Float[Array, "nu"]) -> BraxState:
        """Act for one step."""
        after = guarded_step(self.env, state.pipeline_state, action)
        counted = _COUNTER in state.info  # by Brax, which tells cuts from its own count
        done = after.terminated if counted else after.done
        return _brax_state(after, state.metrics, state.info, done)

    @property
    def observation_size(self) -> int:
        """Length of `obs`."""
        return self.env.observation_size

    @property
    def action_size(self) -> int:
        """Length of the action."""
        return self.env.action_size

    @property
    def dt(self) -> Float[Array, ""]:
        """Time between two actions (s)."""
        return self.env.dt

    @property
    def backend(self) -> str:
        """The physics: always "jaxsim"."""
        return "jaxsim"

    @property
    def unwrapped(self) -> "BraxEnv":
        """This adapter."""
        return self

    @property
    def sys(self) -> Model:
        """The model, under Brax's name; Brax's domain randomisation sets it."""
        return self.env.model

    @sys.setter
    def sys(self, model: Model) -> None:
        self.env = self.env.with_model(model)


def wrap_for_brax(
    env: BraxEnv,
    episode_length: int = 1000,
    action_repeat: int = 1,
    randomization_fn: Callable[[Model], tuple[Model, Any]] | None = None,
):
    """Brax's training wrappers for a batch with the batch on the last axis, which is faster.

    Give it to a Brax trainer as `wrap_env_fn`.

    Args:
      env: the adapter.
      episode_length: steps after which an episode is truncated.
      action_repeat: steps for which an action is repeated.
      randomization_fn: from the model to a batch of models and the axes of its leaves.
    """
    from brax.envs.wrappers import training

    batched: Any = _Batched(env, randomization_fn)
    episodes = training.EpisodeWrapper(batched, episode_length, action_repeat)
    return training.AutoResetWrapper(_cutting(training.Wrapper)(episodes))


@functools.cache
def _cutting(wrapper: type) -> type:
    """A wrapper that ends an episode at the environment's own time limit."""

    class Cut(wrapper):
        def step(self, state, action):
            after = self.env.step(state, action)
            cut = after.pipeline_state.truncated & (after.done == 0)
            info = {**after.info, "truncation": jnp.where(cut, 1, after.info["truncation"])}
            if "episode_done" in info:
                info["episode_done"] = jnp.where(cut, 1, info["episode_done"])
            return after.replace(done=jnp.where(cut, 1, after.done), info=info)

    return Cut


class _Batched:
    """A batch of environments: the first axis of keys, states and actions."""

    def __init__(self, env: BraxEnv, randomization_fn):
        self.env = env
        self._model, self._axes = env.sys, None
        if randomization_fn is not None:
            self._model, self._axes = randomization_fn(env.sys)

    def reset(self, rng):
        return self._mapped("reset")(self._model, rng)

    def step(self, state, action):
        return self._mapped("step")(self._model, state, action)

    def _mapped(self, method: str):
        def one(model, *args):
            return getattr(BraxEnv(self.env.env.with_model(model)), method)(*args)

        def batched(model, *args):
            return vmap(one, in_axes=(self._axes, *(0 for _ in args)))(model, *args)

        return batched

    def __getattr__(self, name: str):
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.env, name)


def _brax_state(
    state: EnvState, metrics: dict[str, Any], info: dict[str, Any], done: Bool[Array, ""]
) -> BraxState:
    """The `BraxState` of a state; entries that Brax's wrappers have added are kept."""
    dtype = state.reward.dtype
    return BraxState(
        pipeline_state=state,
        obs=state.obs,
        reward=state.reward,
        done=done.astype(dtype),
        metrics={**metrics, **state.metrics},
        info={**info, "truncation": state.truncated.astype(dtype)},
    )
