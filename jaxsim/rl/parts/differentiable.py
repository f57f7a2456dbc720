"""Environments for reverse mode, with bounded memory and bounded gradients."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.engine.kernels import reverse_only
from jaxsim.envs import EnvState, TimeLimit, Wrapper, extended
from jaxsim.gradients import clip_cotangent
from jaxsim.rl.parts.collect import Actors

# Gradients with larger entries count as overflow.
NO_LIMIT = 1e18


@struct.dataclass
class Differentiable(Wrapper):
    """The same environment, prepared for reverse mode through many steps.

    The backward pass recomputes each step, so that a rollout stores only states and accelerations;
    where steps are kernels on a CPU, so is their derivative.
    The cotangent of each step is bounded. If it is not finite (after a simulation has diverged and
    `AutoReset` has replaced it), it is set to zero, and this environment adds nothing to the
    gradient. If its norm exceeds `limit`, it is scaled down, because products of Jacobians grow
    exponentially in chaotic motion. Other environments of a batch are not affected.

    Attributes:
      limit: greatest norm of the cotangent of state and action of one step.
    """

    limit: float = struct.field(pytree_node=False, default=NO_LIMIT)

    def step(self, state: EnvState, action: Float[Array, "nu"]) -> EnvState:
        """Act for one step."""
        state, action = clip_cotangent((state, action), self.limit)
        model = reverse_only(self.env.model)
        if not model.backward.reverse_only:
            return checkpoint(self.env.step)(state, action)
        # Kernels store no more than states by themselves.
        return self.env.with_model(model).step(state, action)


def cut_episodes(env: Any, steps: int | None) -> Any:
    """An `AutoReset` with episodes of at most this many steps; None changes nothing."""
    return env if steps is None else env.replace(env=TimeLimit(env.env, max_episode_steps=steps))


def spread_episodes(actors: Actors, keys, steps: int | None) -> Actors:
    """Make the first episodes end at different times, as if they had started earlier.

    If all environments started and ended together, the learner would see the same phase of the task
    in all of them. Only the counter of `TimeLimit` is changed; nothing is if `steps` is None.
    """
    if steps is None:
        return actors
    begun = jax.vmap(lambda key: jax.random.randint(jax.random.fold_in(key, 1), (), 0, steps))(keys)
    return actors.replace(env=extended(actors.env, steps=begun.astype(jnp.int32)))


def discounts(done: Bool[Array, "T"], discount: float) -> Float[Array, "T"]:
    """Weights w_t of rewards that are counted from the last start of an episode.

    w_0 = 1,   w_{t+1} = 1 where an episode ended with step t, else discount w_t

    Args:
      done: whether the episode ended with a step, for either reason.
      discount: factor per step.
    """

    def body(weight, done):
        return jnp.where(done, 1, discount * weight).astype(weight.dtype), weight

    return jax.lax.scan(body, jnp.ones(()), done)[1]
