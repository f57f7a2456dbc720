"""Many environments in one compiled call: all devices, chunks that fit in the cache, cheap resets.

Resets are rare: of a thousand environments only a few end in one step. So resets are not computed
for all environments, but only for those that need one, gathered in chunks (`reset_where`).

Each environment has a chain of random keys that starts at its seed. A reset draws one key from the
chain, so environment i of a batch has the same episodes as a single environment with its seed.
"""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.batching import vmap
from jaxsim.envs.base.diverged import diverged
from jaxsim.envs.base.env import Env, EnvState
from jaxsim.parallel.chunks import even_lanes, map_chunks

RESET_LANES = 64  # environments that are reset together


@struct.dataclass
class Batch:
    """The state between steps; every array has a leading batch axis.

    Attributes:
      states: the environments.
      keys: the chain of random keys of each environment.
    """

    states: EnvState
    keys: Array


def check_single(env: Env) -> None:
    """Say that bridges batch an environment themselves.

    Raises:
      ValueError: the environment holds a batch of models.
    """
    if env.model.qpos0.ndim != 1:
        raise ValueError(
            "one environment is needed, which is batched here; this one holds a batch of models "
            f"of shape {env.model.qpos0.shape[:-1]}: wrap one in jaxsim.envs.wrappers.Randomize "
            "for models that differ"
        )


def root_keys(seeds: Sequence[int]) -> Array:
    """The start of each environment's chain of keys, from any non-negative integers."""
    words = [np.random.SeedSequence(seed).generate_state(1)[0] for seed in seeds]
    return jax.vmap(jax.random.key)(jnp.asarray(np.array(words, np.uint32)))


def restart(env: Env, key: Array) -> tuple[EnvState, Array]:
    """A new episode, and the chain of keys after it."""
    key, draw = jax.random.split(key)
    state = env.reset(draw)
    metrics = {**state.metrics, "nonfinite": jnp.zeros_like(state.reward)}
    return state.replace(metrics=metrics), key


def guarded_step(env: Env, state: EnvState, action: Float[Array, "nu"]) -> EnvState:
    """One step; if it has `diverged`, the episode ends and its numbers are discarded.

    The environment then keeps its previous state, `terminated`, with reward 0 and
    `metrics["nonfinite"]` 1, which otherwise is 0.
    """
    after = env.step(state, action)
    broken = diverged(after)
    stay = state.replace(
        reward=jnp.zeros_like(after.reward),
        terminated=jnp.ones_like(after.terminated),
        truncated=jnp.zeros_like(after.truncated),
        metrics=jax.tree.map(jnp.zeros_like, after.metrics),
    )
    chosen = jax.tree.map(functools.partial(jnp.where, broken), stay, after)
    count = broken.astype(after.reward.dtype)
    return chosen.replace(metrics={**chosen.metrics, "nonfinite": count})


def reset_where(env: Env, batch: Batch, mask: Bool[Array, "n"]) -> Batch:
    """Reset the environments in the mask; the cost is proportional to their number."""
    n = mask.shape[0]
    size = min(n, RESET_LANES)
    # Unused slots have an index out of range, and are not written.
    places = jnp.nonzero(mask, size=-(-n // size) * size, fill_value=n)[0]
    count = mask.sum()

    def body(carry):
        start, batch = carry
        index = lax.dynamic_slice(places, (start,), (size,))
        keys = jnp.take(batch.keys, index, mode="clip")
        fresh = Batch(*vmap(functools.partial(restart, env))(keys))
        batch = jax.tree.map(lambda x, new: x.at[index].set(new, mode="drop"), batch, fresh)
        return start + size, batch

    return lax.while_loop(lambda carry: carry[0] < count, body, (jnp.zeros_like(count), batch))[1]


def step_all(env: Env, states: EnvState, actions: Float[Array, "n nu"]) -> EnvState:
    """One step of every environment, on a CPU in chunks that fit in the cache."""
    step = vmap(functools.partial(guarded_step, env))
    lanes = even_lanes(env.unwrapped.model, actions.shape[0])
    return map_chunks(step, lanes, states, actions)
