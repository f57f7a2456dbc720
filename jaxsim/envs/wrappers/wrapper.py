"""`Wrapper`: an environment around another."""

from flax import struct

from jaxsim.envs.base.env import Env, EnvState
from jaxsim.model import Model


@struct.dataclass
class Wrapper(Env):
    """Base of wrappers: an environment that forwards everything to the one inside.

    The state of a wrapper is an entry of `EnvState.info` with its own name, which the environments
    inside preserve.

    Attributes:
      env: the environment inside.
    """

    env: Env

    def reset(self, key) -> EnvState:
        """Start an episode."""
        return self.env.reset(key)

    def step(self, state, action) -> EnvState:
        """Act for one step."""
        return self.env.step(state, action)

    def with_model(self, model: Model) -> "Wrapper":
        """The same environment with other physics."""
        return self.replace(env=self.env.with_model(model))

    @property
    def model(self) -> Model:
        """The physics of the environment inside."""
        return self.env.model

    @property
    def frame_skip(self) -> int:
        """Time steps for each action."""
        return self.env.frame_skip

    @property
    def unwrapped(self) -> Env:
        """The task inside all wrappers."""
        return self.env.unwrapped

    @property
    def episode_limit(self) -> int | None:
        """Steps after which an episode is cut at the latest; None where nothing cuts it."""
        return self.env.episode_limit

    @property
    def dt(self):
        """Time between two actions (s)."""
        return self.env.dt

    @property
    def action_size(self) -> int:
        """Length of the action."""
        return self.env.action_size

    @property
    def action_low(self):
        """Smallest action that makes a difference."""
        return self.env.action_low

    @property
    def action_high(self):
        """Largest action that makes a difference."""
        return self.env.action_high


def extended(state: EnvState, **info) -> EnvState:
    """The state with additional or changed entries of `info`."""
    return state.replace(info={**state.info, **info})
