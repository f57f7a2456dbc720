"""`TimeLimit`: episodes of limited length."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class TimeLimit(Wrapper):
    """Truncates an episode after a number of steps; `info["steps"]` counts them.

    Attributes:
      max_episode_steps: length of an episode.
    """

    max_episode_steps: int = struct.field(pytree_node=False, default=1000)

    @property
    def episode_limit(self) -> int:
        """Steps after which an episode is cut at the latest."""
        inner = self.env.episode_limit
        return self.max_episode_steps if inner is None else min(self.max_episode_steps, inner)

    def reset(self, key) -> EnvState:
        """Start an episode, at step zero."""
        return extended(self.env.reset(key), steps=jnp.zeros((), jnp.int32))

    def step(self, state, action) -> EnvState:
        """Act for one step, and count it."""
        after = self.env.step(state, action)
        steps = state.info["steps"] + 1
        late = (steps >= self.max_episode_steps) & ~after.terminated
        return extended(after.replace(truncated=after.truncated | late), steps=steps)
