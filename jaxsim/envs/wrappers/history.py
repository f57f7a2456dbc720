"""`History`: the last observations as one vector."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class History(Wrapper):
    """Observes the last observations, oldest first, as one vector.

    Observations before the first one are equal to it. `info["history"]` (length, n) are the last
    observations.

    Attributes:
      length: number of observations.
    """

    length: int = struct.field(pytree_node=False, default=3)

    def reset(self, key) -> EnvState:
        """Start an episode."""
        state = self.env.reset(key)
        return self._observing(state, jnp.stack([state.obs] * self.length))

    def step(self, state, action) -> EnvState:
        """Act for one step."""
        after = self.env.step(state, action)
        return self._observing(after, pushed(state.info["history"], after.obs))

    def _observing(self, state: EnvState, history) -> EnvState:
        return extended(state.replace(obs=history.reshape(-1)), history=history)


def pushed(queue, newest):
    """The queue, oldest entry first, without its oldest entry and with a new one."""
    return jnp.concatenate([queue[1:], newest[None]])
