"""`fast`: an environment of a few operations, for tests of learners."""

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Env, EnvState, static
from jaxsim.envs.base.start import load_asset, start_from
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Fast(Env):
    """A point on a line that moves by a tenth of the action; no forces, no time to simulate.

    Observation (1,): the position x (m).

    Action (1,): velocity within (-1, 1); x changes by 0.1 times it.

    Reward: `1 - x^2 - 0.01 action^2`, so that the best policy earns nearly 1 per step.

    Episode: x starts uniformly within (-1, 1); terminated where |x| > 2; cut after 20 steps.

    Gymnasium: not there.

    Brax: its environment of that name is another one.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("fast"))
    frame_skip: int = static(1)

    def reset(self, key):
        """Start anywhere in (-1, 1)."""
        qpos = jax.random.uniform(key, (1,), minval=-1.0, maxval=1.0)
        state = start_from(self.model, qpos, jnp.zeros(1))
        zero, no = jnp.zeros((), state.qpos.dtype), jnp.zeros((), bool)
        return EnvState(state, state.qpos, zero, no, no, {"distance": zero}, {})

    def step(self, state, action):
        """Move by a tenth of the action."""
        velocity = jnp.clip(action, -1, 1)
        x = state.state.qpos + self.dt * velocity
        moved = state.state.replace(qpos=x, qvel=velocity, time=state.state.time + self.dt)
        return state.replace(
            state=moved,
            obs=x,
            reward=1 - x[0] ** 2 - 0.01 * action[0] ** 2,
            terminated=jnp.abs(x[0]) > 2,
            truncated=jnp.zeros((), bool),
            metrics={"distance": jnp.abs(x[0])},
        )
