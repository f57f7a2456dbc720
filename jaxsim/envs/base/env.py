"""`EnvState`, `Env` and `Task`: the interface of environments, and the base class of tasks.

Your own task is a record that derives from `Task`, of about 40 lines:

  @struct.dataclass(kw_only=True)
  class Balance(Task):
    model: Model = struct.field(default_factory=lambda: load_asset("inverted_pendulum"))
    frame_skip: int = static(2)
    noise: float = 0.01

    def start(self, key):
      return uniform_start(self.model, key, self.noise)

    def observe(self, now):
      return jnp.concatenate([now.qpos, now.qvel])

    def reward(self, before, now, action):
      return 1 - now.qpos[1] ** 2, {}

  jaxsim.envs.register("balance", Balance, max_episode_steps=500)
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from jaxsim.arrays.precision import full_precision
from jaxsim.engine.status import Status
from jaxsim.envs.base.advance import advance
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.solves import Solves
from jaxsim.model import Model, State


@struct.dataclass
class EnvState:
    """One environment at one time; batches come from `jaxsim.vmap`.

    Attributes:
      state: the physics.
      obs: what the agent sees.
      reward: reward of the last step.
      terminated: whether the task ended in this state, after which there are no rewards.
      truncated: whether the episode was cut off here, although the task could go on.
      metrics: terms of the reward and other numbers; the same keys after reset and step.
      info: values that the task and wrappers carry to the next step; the same keys after reset and
        step.
      solves: status of the solves of the last step; None if the environment does not report it.
    """

    state: State
    obs: Float[Array, "n"]
    reward: Float[Array, ""]
    terminated: Bool[Array, ""]
    truncated: Bool[Array, ""]
    metrics: dict[str, Array]
    info: dict[str, Any]
    solves: Solves | None = None

    @property
    def done(self) -> Bool[Array, ""]:
        """Whether the episode is over, for either reason."""
        return self.terminated | self.truncated


class Env:
    """An immutable environment, a pytree with its model; `reset` and `step` are pure functions.

    Tasks derive from `Task`, wrappers from `Wrapper`.
    """

    model: Model
    frame_skip: int

    def reset(self, key: PRNGKeyArray) -> EnvState:
        """Start an episode at random."""
        raise TypeError(f"{type(self).__name__} does not define reset")

    def step(self, state: EnvState, action: Float[Array, "nu"]) -> EnvState:
        """Act for one step; the caller decides what to do after the end of an episode."""
        raise TypeError(f"{type(self).__name__} does not define step")

    def with_model(self, model: Model) -> "Env":
        """The same environment with other physics."""
        return self.replace(model=model)

    @property
    def unwrapped(self) -> "Env":
        """The task inside all wrappers."""
        return self

    @property
    def dt(self) -> Float[Array, ""]:
        """Time between two actions (s)."""
        return self.model.opt.timestep * self.frame_skip

    @property
    def episode_limit(self) -> int | None:
        """Steps after which an episode is cut at the latest; None where nothing cuts it."""
        return None

    @property
    def observation_size(self) -> int:
        """Length of `obs`."""
        return jax.eval_shape(self.reset, jax.random.key(0)).obs.shape[0]

    @property
    def action_size(self) -> int:
        """Length of the action."""
        return self.model.nu

    @property
    def action_low(self) -> np.ndarray:
        """Smallest action that makes a difference; -inf where the model sets no limit."""
        return self._action_bound(0, -np.inf)

    @property
    def action_high(self) -> np.ndarray:
        """Largest action that makes a difference; inf where the model sets no limit."""
        return self._action_bound(1, np.inf)

    def _action_bound(self, column: int, unlimited: float) -> np.ndarray:
        bound = np.asarray(self.model.actuator_ctrlrange)[:, column]
        return np.where(self.model.actuator_ctrllimited, bound, unlimited).astype(bound.dtype)

    replace: Any  # every environment is a flax record


@struct.dataclass(kw_only=True)
class Task(Env):
    """A task: a model with starts, observations and rewards; its fields are its options.

    Attributes:
      model: the physics.
      frame_skip: time steps for each action.
    """

    model: Model
    frame_skip: int = struct.field(pytree_node=False, default=1)

    def start(self, key: PRNGKeyArray) -> State:
        """A random state to start from."""
        raise TypeError(f"{type(self).__name__} does not define start")

    def observe(self, now: Moment) -> Float[Array, "n"]:
        """The observation of the agent."""
        raise TypeError(f"{type(self).__name__} does not define observe")

    def reward(
        self, before: dict[str, Any], now: Moment, action: Float[Array, "nu"]
    ) -> tuple[Any, dict[str, Any]]:
        """Reward of a step, and its terms by name.

        Args:
          before: `EnvState.info` before the step.
          now: the moment after the step.
          action: the action of the agent.
        """
        raise TypeError(f"{type(self).__name__} does not define reward")

    def terminated(self, now: Moment) -> Bool[Array, ""]:
        """Whether the task ends here."""
        return jnp.zeros((), bool)

    def draw(self, key: PRNGKeyArray) -> dict[str, Any]:
        """Random values besides the state, such as a goal; `now.before` at the reset has them."""
        return {}

    def info(self, now: Moment) -> dict[str, Any]:
        """Values to carry to the next step; other entries of `info` keep their values."""
        return {}

    def control(self, action: Float[Array, "nu"]) -> Float[Array, "nu"]:
        """Controls for an action; the physics clamps them to the actuators' ranges."""
        return action

    def reset(self, key: PRNGKeyArray) -> EnvState:
        """Start an episode at random."""
        state_key, draw_key = jax.random.split(key)
        return self.reset_to(self.start(state_key), self.draw(draw_key))

    @full_precision
    def reset_to(self, state: State, drawn: dict[str, Any] | None = None) -> EnvState:
        """Start an episode from a given state.

        Args:
          state: the physics.
          drawn: values in place of those of `draw`.
        """
        action = jnp.zeros(self.action_size, state.qpos.dtype)
        drawn = {} if drawn is None else drawn
        now = Moment(self.model, state, state, jnp.zeros_like(action), action, drawn)
        info = {**drawn, **self.info(now)}
        # A copy, because values that a moment has cached must not leave the trace.
        terms = jax.eval_shape(lambda: self._outcome(info, now.replace(), action))[1]
        return EnvState(
            state=state,
            obs=self.observe(now),
            reward=jnp.zeros((), state.qpos.dtype),
            terminated=jnp.zeros((), bool),
            truncated=jnp.zeros((), bool),
            metrics=jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), terms),
            info=jax.tree.map(jnp.asarray, info),
            solves=Solves.of(Status.empty(state.qpos.dtype)),
        )

    @full_precision
    def step(self, state: EnvState, action: Float[Array, "nu"]) -> EnvState:
        """Act for `frame_skip` time steps."""
        ctrl = self.control(action)
        found = advance(self.model, state.state, ctrl, self.frame_skip)
        now = Moment(self.model, found.after, found.last, ctrl, action, state.info, found.qacc)
        reward, metrics = self._outcome(state.info, now, action)
        return EnvState(
            state=found.after,
            obs=self.observe(now),
            reward=reward,
            terminated=jnp.asarray(self.terminated(now), bool),
            truncated=jnp.zeros((), bool),
            metrics=metrics,
            info={**state.info, **jax.tree.map(jnp.asarray, self.info(now))},
            solves=Solves.of(found.status),
        )

    def _outcome(self, before, now: Moment, action):
        """Reward and metrics as arrays of the model's type."""
        values = self.reward(before, now, action)
        return jax.tree.map(lambda x: jnp.asarray(x, now.qpos.dtype), values)


def static(default: Any) -> Any:
    """A static field of a task, which decides a shape or a branch: an integer, a flag or a name."""
    return struct.field(pytree_node=False, default=default)
