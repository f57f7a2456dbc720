"""Normalisation of observations and rewards by given statistics."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper


@struct.dataclass
class NormalizeObservation(Wrapper):
    """Replaces observations by `(obs - mean) / std`, clipped.

    The statistics are leaves, which the user updates with `replace`; an environment does not change
    itself.

    Attributes:
      mean: mean of the observations; a scalar applies to all.
      std: their standard deviation.
      limit: bound of the normalised observations.
    """

    mean: Float[Array, "n"] | float = 0.0
    std: Float[Array, "n"] | float = 1.0
    limit: float = 10.0

    def reset(self, key) -> EnvState:
        """Start an episode."""
        return self._scaled(self.env.reset(key))

    def step(self, state, action) -> EnvState:
        """Act for one step."""
        return self._scaled(self.env.step(state, action))

    def _scaled(self, state: EnvState) -> EnvState:
        obs = (state.obs - self.mean) / self.std
        return state.replace(obs=jnp.clip(obs, -self.limit, self.limit))


@struct.dataclass
class NormalizeReward(Wrapper):
    """Replaces rewards by `reward / std`, clipped; usually std is that of the discounted return.

    Attributes:
      std: standard deviation to divide by.
      limit: bound of the normalised rewards.
    """

    std: Float[Array, ""] | float = 1.0
    limit: float = 10.0

    def step(self, state, action) -> EnvState:
        """Act for one step."""
        after = self.env.step(state, action)
        return after.replace(reward=jnp.clip(after.reward / self.std, -self.limit, self.limit))
