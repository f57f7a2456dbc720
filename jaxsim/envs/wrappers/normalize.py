"""Observations and rewards of unit size, by statistics that are data."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper


@struct.dataclass
class NormalizeObservation(Wrapper):
    """Gives `(obs - mean) / std`, clipped.

    The statistics are leaves: whoever collects them puts newer ones in place with `replace`. An
    environment never changes by itself.

    Attributes:
      mean: mean of the observations; a scalar serves for all.
      std: their standard deviation.
      limit: what is given stays within this many deviations.
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
    """Gives `reward / std`, clipped; usually by the deviation of the discounted return.

    Attributes:
      std: standard deviation to divide by.
      limit: what is given stays within this many deviations.
    """

    std: Float[Array, ""] | float = 1.0
    limit: float = 10.0

    def step(self, state, action) -> EnvState:
        """Act for one step."""
        after = self.env.step(state, action)
        return after.replace(reward=jnp.clip(after.reward / self.std, -self.limit, self.limit))
