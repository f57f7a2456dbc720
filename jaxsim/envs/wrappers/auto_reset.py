"""`AutoReset`: a new episode starts when one ends."""

import functools

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.diverged import diverged
from jaxsim.envs.base.env import EnvState
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class AutoReset(Wrapper):
    """Starts a new random episode in the step in which an episode ends.

    `obs`, `state` and the inner `info` are then those of the new episode. Reward, `terminated`,
    `truncated`, metrics and solves are those of the last step of the old one, and
    `info["terminal_obs"]` is its last observation (in other steps: the current observation).

    A step that has `diverged` also ends its episode, with `terminated`, reward 0, and metrics 0
    except `metrics["nonfinite"]`, which is 1 (in other steps 0). Its numbers are discarded.

    `info["reset_key"]` is the random key of the next episodes.
    """

    def reset(self, key) -> EnvState:
        """Start the first episode."""
        key, rest = jax.random.split(key)
        state = self.env.reset(key)
        metrics = {**state.metrics, "nonfinite": jnp.zeros_like(state.reward)}
        return extended(state.replace(metrics=metrics), reset_key=rest, terminal_obs=state.obs)

    def step(self, state, action) -> EnvState:
        """Act for one step, and reset if the episode has ended."""
        key, rest = jax.random.split(state.info["reset_key"])
        fresh, after = self.env.reset(key), self.env.step(state, action)
        broken = diverged(after)
        done = after.done | broken
        metrics = {**_select(broken, jax.tree.map(jnp.zeros_like, after.metrics), after.metrics)}
        inner = {name: after.info[name] for name in fresh.info}
        return EnvState(
            state=_select(done, fresh.state, after.state),
            obs=jnp.where(done, fresh.obs, after.obs),
            reward=jnp.where(broken, 0, after.reward),
            terminated=after.terminated | broken,
            truncated=after.truncated & ~broken,
            metrics={**metrics, "nonfinite": broken.astype(after.reward.dtype)},
            info={
                **after.info,
                **_select(done, fresh.info, inner),
                "reset_key": rest,
                "terminal_obs": jnp.where(broken, fresh.obs, after.obs),
            },
            solves=after.solves,
        )


def _select(which, a, b):
    return jax.tree.map(functools.partial(jnp.where, which), a, b)
