"""Generalised advantage estimation."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def advantages(
    reward: Float[Array, "T"],
    value: Float[Array, "T"],
    next_value: Float[Array, "T"],
    terminated: Bool[Array, "T"],
    truncated: Bool[Array, "T"],
    discount: float,
    decay: float,
) -> Float[Array, "T"]:
    """Advantages A_t of the actions of one environment (Schulman et al. 2016, eq. 16).

    delta_t = r_t + discount (1 - terminated_t) V(s'_t) - V(s_t)
    A_t = delta_t + discount decay (1 - terminated_t) (1 - truncated_t) A_{t+1},   A_T = 0

    s'_t is the state after the action, before a possible reset: a termination ends the return, a
    truncation only ends the data.

    Args:
      reward: r_t.
      value: V(s_t), the value of the state in which the action was taken.
      next_value: V(s'_t).
      terminated: the episode ended in s'_t.
      truncated: the episode was truncated at s'_t.
      discount: factor per step of the return, gamma.
      decay: weight of long returns against bootstrapping, lambda.

    Returns:
      A_t; the targets of the value function are A_t + V(s_t).
    """
    delta = reward + discount * jnp.where(terminated, 0, next_value) - value
    carry_on = jnp.where(terminated | truncated, 0, discount * decay).astype(delta.dtype)

    def body(after, step):
        delta_t, factor = step
        now = delta_t + factor * after
        return now, now

    zero = jnp.zeros((), delta.dtype)
    return jax.lax.scan(body, zero, (delta, carry_on), reverse=True)[1]
