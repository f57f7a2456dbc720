"""Evaluation: whole episodes of a deterministic policy, from fresh starts to their ends."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.batching import vmap
from jaxsim.envs import Env


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
        """Summary for logs."""
        return {
            "eval_return": float(self.returns.mean()),
            "eval_return_std": float(self.returns.std()),
            "eval_return_min": float(self.returns.min()),
            "eval_length": float(self.lengths.mean()),
        }


def evaluate(env: Env, policy: Any, keys, max_steps: int) -> Evaluation:
    """Run one episode for each key, all at the same time.

    The return of an episode counts up to and including the step that ends it, as an evaluation in
    Gymnasium would; the loop stops when the last episode has ended.

    Args:
      env: the environment, without `AutoReset`.
      policy: function of a batch of observations.
      keys: one random key for each episode.
      max_steps: episodes end here at the latest.
    """
    state = vmap(env.reset)(keys)

    def unfinished(carry):
        _, alive, _, step = carry
        return alive.any() & (step < max_steps)

    def body(carry):
        state, alive, result, step = carry
        after = vmap(env.step)(state, policy(state.obs))
        # Only a diverged simulation gives no number; its episode ends without that reward.
        reward = jnp.where(alive & jnp.isfinite(after.reward), after.reward, 0)
        result = Evaluation(result.returns + reward, result.lengths + alive)
        over = after.terminated | after.truncated | ~jnp.isfinite(after.reward)
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
