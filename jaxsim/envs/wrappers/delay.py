"""Actions and observations that arrive late."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.history import pushed
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class Delay(Wrapper):
    """Acts with the action, and shows the observation, of some steps ago.

    Zero actions come before the first one; an episode starts as if its first observation had been
    there for long. `info["late_actions"]` and `info["late_obs"]` hold what is under way.

    Attributes:
      action: steps by which actions are late.
      observation: steps by which observations are late.
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
        """Act for one step with what was asked for before."""
        actions = pushed(state.info["late_actions"], action)
        after = self.env.step(state, actions[0])
        seen = pushed(state.info["late_obs"], after.obs)
        return extended(after.replace(obs=seen[0]), late_actions=actions, late_obs=seen)
