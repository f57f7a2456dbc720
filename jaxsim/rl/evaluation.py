"""Evaluation: whole episodes of a deterministic policy, from new starts to their ends."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.batching import vmap
from jaxsim.envs import Env
from jaxsim.envs.base.diverged import diverged


@struct.dataclass
class Evaluation:
    """Results of episodes.

    Attributes:
      returns: sums of the rewards.
      lengths: steps.
    """

    returns: Float[Array, "n"]
    lengths: Int[Array, "n"]

    def metrics(self) -> dict[str, float]:
        """Summary for logs, on the host: on the device it would come after what runs there."""
        returns, lengths = jax.device_get((self.returns, self.lengths))
        return {
            "eval_return": float(returns.mean()),
            "eval_return_std": float(returns.std()),
            "eval_return_min": float(returns.min()),
            "eval_length": float(lengths.mean()),
        }


def evaluate(env: Env, policy: Any, keys, max_steps: int | None = None) -> Evaluation:
    """Run one episode for each key, all at the same time.

    The return of an episode counts up to and including the step that ends it, as an evaluation in
    Gymnasium would; the loop stops when the last episode has ended.

    Args:
      env: the environment, without `AutoReset`.
      policy: function of a batch of observations.
      keys: one random key for each episode.
      max_steps: episodes end here at the latest; by default at the environment's own limit, or
        after 1000 steps where it has none.
    """
    longest = max_steps or env.episode_limit or 1000
    state = vmap(env.reset)(keys)

    def unfinished(carry):
        _, alive, _, step = carry
        return alive.any() & (step < longest)

    def body(carry):
        state, alive, result, step = carry
        after = vmap(env.step)(state, policy(state.obs))
        broken = jax.vmap(diverged)(after)  # such an episode ends without that reward
        reward = jnp.where(alive & ~broken, after.reward, 0)
        result = Evaluation(result.returns + reward, result.lengths + alive)
        over = after.terminated | after.truncated | broken
        state = jax.tree.map(lambda new, old: _where(alive, new, old), after, state)
        return state, alive & ~over, result, step + 1

    zeros = jnp.zeros_like(state.reward)
    start = Evaluation(zeros, zeros.astype(int))
    carry = (state, jnp.ones(zeros.shape, bool), start, jnp.zeros((), int))
    return lax.while_loop(unfinished, body, carry)[2]


def _where(alive, new, old):
    """Select along the first axis, keys included."""
    mask = jnp.reshape(alive, (-1,) + (1,) * (new.ndim - 1))
    return jnp.where(jnp.broadcast_to(mask, new.shape), new, old)
