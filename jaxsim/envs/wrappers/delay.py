"""`Delay`: actions and observations with a delay."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.history import pushed
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class Delay(Wrapper):
    """Delays actions and observations by some steps.

    Actions before the first one are zero, and observations before the first one are equal to it.
    `info["late_actions"]` and `info["late_obs"]` are the queues.

    Attributes:
      action: delay of actions in steps.
      observation: delay of observations in steps.
    """

    action: int = struct.field(pytree_node=False, default=1)
    observation: int = struct.field(pytree_node=False, default=0)

    def reset(self, key) -> EnvState:
        """Start an episode."""
        state = self.env.reset(key)
        return extended(
            state,
            late_actions=jnp.zeros((self.action + 1, self.action_size), state.obs.dtype),
            late_obs=jnp.stack([state.obs] * (self.observation + 1)),
        )

    def step(self, state, action) -> EnvState:
        """Act for one step with a delayed action."""
        actions = pushed(state.info["late_actions"], action)
        after = self.env.step(state, actions[0])
        seen = pushed(state.info["late_obs"], after.obs)
        return extended(after.replace(obs=seen[0]), late_actions=actions, late_obs=seen)
