"""`Noise`: noise on observations and actions."""

import jax
from flax import struct
from jaxtyping import Array, Float

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class Noise(Wrapper):
    """Adds normal noise to observations and actions; `info["noise_key"]` is its random key.

    Attributes:
      observation: standard deviation for observations, one for all or one for each.
      action: standard deviation for actions.
    """

    observation: Float[Array, "n"] | float = 0.01
    action: Float[Array, "nu"] | float = 0.0

    def reset(self, key) -> EnvState:
        """Start an episode."""
        key, noise_key = jax.random.split(key)
        return self._seen(self.env.reset(key), noise_key)

    def step(self, state, action) -> EnvState:
        """Act for one step."""
        key, action_key = jax.random.split(state.info["noise_key"])
        return self._seen(self.env.step(state, self._noisy(action_key, action, self.action)), key)

    def _seen(self, state: EnvState, key) -> EnvState:
        key, obs_key = jax.random.split(key)
        obs = self._noisy(obs_key, state.obs, self.observation)
        return extended(state.replace(obs=obs), noise_key=key)

    def _noisy(self, key, x, std):
        return x + std * jax.random.normal(key, x.shape, x.dtype)
