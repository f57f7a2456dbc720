"""`ActionRepeat`: several steps for each action."""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper


@struct.dataclass
class ActionRepeat(Wrapper):
    """Repeats each action and sums the rewards; steps after the end of an episode do nothing.

    Unlike with a larger `frame_skip`, the task is evaluated in each step. Metrics are those of the
    last step.

    Attributes:
      repeats: steps of the inner environment for each action.
    """

    repeats: int = struct.field(pytree_node=False, default=2)

    def step(self, state, action) -> EnvState:
        """Act for several steps."""

        def again(carry, _):
            now, total = carry
            after = self.env.step(now, action)
            total = total + jnp.where(now.done, 0, after.reward)
            return (jax.tree.map(lambda a, b: jnp.where(now.done, a, b), now, after), total), None

        # Outer wrappers may have changed entries that the inner environment does not return.
        inner = jax.eval_shape(self.env.step, state, action)
        blank = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), inner.replace(info={}))
        start = blank.replace(state=state.state, info=state.info)
        (after, total), _ = lax.scan(again, (start, blank.reward), length=self.repeats)
        return after.replace(reward=total)

    @property
    def episode_limit(self) -> int | None:
        """Steps after which an episode is cut at the latest; None where nothing cuts it."""
        inner = self.env.episode_limit
        return None if inner is None else -(-inner // self.repeats)

    @property
    def dt(self):
        """Time between two actions (s)."""
        return self.repeats * self.env.dt

    @property
    def frame_skip(self) -> int:
        """Time steps for each action."""
        return self.repeats * self.env.frame_skip
