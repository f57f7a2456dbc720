"""Experience: many environments stepped by a policy, in chunks that fit in a CPU's cache."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.batching import vmap
from jaxsim.envs import Env, EnvState
from jaxsim.envs.base import Solves
from jaxsim.parallel.chunks import even_lanes
from jaxsim.parallel.devices import AXIS


@struct.dataclass
class Actors:
    """Environments during their episodes; the first axis of all leaves is the environment.

    Attributes:
      env: states of the environments.
      episode_return: rewards of the present episode so far.
      episode_length: steps of the present episode so far.
    """

    env: EnvState
    episode_return: Float[Array, "n"]
    episode_length: Int[Array, "n"]


@struct.dataclass
class Experience:
    """Steps of environments; leaves are (T, n, ...), time first.

    Attributes:
      obs: observation from which the action was chosen.
      action: the action in the environment's units.
      extras: other results of the policy, such as the log probability of the action.
      reward: reward of the step.
      next_obs: observation after the step, before a possible reset.
      terminated: whether the task ended with this step.
      truncated: whether the episode was truncated after this step.
    """

    obs: Float[Array, "T n obs"]
    action: Float[Array, "T n nu"]
    extras: Any
    reward: Float[Array, "T n"]
    next_obs: Float[Array, "T n obs"]
    terminated: Bool[Array, "T n"]
    truncated: Bool[Array, "T n"]


@struct.dataclass
class Episodes:
    """Sums over the episodes that ended, and numbers of steps with problems.

    Attributes:
      returns: sum of the returns.
      lengths: sum of the lengths in steps.
      count: number of episodes.
      nonfinite: number of environments that were reset because of a NaN or an infinity.
      lost_contacts: number of steps in which contacts were lost for lack of slots.
      unconverged: number of steps in which a solve ran out of iterations.
    """

    returns: Float[Array, ""]
    lengths: Float[Array, ""]
    count: Float[Array, ""]
    nonfinite: Float[Array, ""]
    lost_contacts: Float[Array, ""]
    unconverged: Float[Array, ""]

    def metrics(self) -> dict[str, Array]:
        """Means over the episodes of all devices; NaN if none has ended."""
        total = lax.psum(self, AXIS)
        return {
            "episode_return": total.returns / total.count,
            "episode_length": total.lengths / total.count,
            "episodes": total.count,
            "nonfinite": total.nonfinite,
            "lost_contacts": total.lost_contacts,
            "unconverged": total.unconverged,
        }


# From observations (n, obs) and a key to actions (n, nu) and extras.
Act = Callable[[Float[Array, "n obs"], Any], tuple[Float[Array, "n nu"], Any]]


def start_actors(env: Env, keys) -> Actors:
    """Reset one environment for each key."""
    state = vmap(env.reset)(keys).replace(solves=None)
    zeros = jnp.zeros_like(state.reward)
    return Actors(state, zeros, zeros.astype(int))


def collect(
    env: Env, act: Act, actors: Actors, key, steps: int
) -> tuple[Actors, Experience, Episodes]:
    """Take `steps` steps in every environment.

    Args:
      env: the environment, with `AutoReset`.
      act: function that chooses actions.
      actors: the environments.
      key: random key for `act`.
      steps: number of steps T of each environment.

    Returns:
      The environments after the steps, the experience, and sums over the episodes that ended.
    """
    count = actors.episode_return.shape[0]
    lanes = even_lanes(env.unwrapped.model, count)

    def chunk(args):
        actors, key = args
        return lax.scan(lambda a, k: _step(env, act, a, k), actors, jax.random.split(key, steps))

    if lanes == count:
        actors, (experience, episodes) = chunk((actors, key))
    else:
        keys = jax.random.split(key, count // lanes)
        split = jax.tree.map(lambda x: x.reshape(count // lanes, lanes, *x.shape[1:]), actors)
        actors, (experience, episodes) = lax.map(chunk, (split, keys))
        actors = jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), actors)
        experience = jax.tree.map(_join_chunks, experience)
    return actors, experience, jax.tree.map(jnp.sum, episodes)


def _step(env: Env, act: Act, actors: Actors, key) -> tuple[Actors, tuple[Experience, Episodes]]:
    """One step of the environments of a chunk."""
    before = actors.env
    action, extras = act(before.obs, key)
    after = vmap(env.step)(before, action)
    done = after.terminated | after.truncated
    experience = Experience(
        obs=before.obs,
        action=action,
        extras=extras,
        reward=after.reward,
        next_obs=after.info["terminal_obs"],
        terminated=after.terminated,
        truncated=after.truncated,
    )
    returns = actors.episode_return + after.reward
    lengths = actors.episode_length + 1
    episodes = Episodes(
        returns=jnp.where(done, returns, 0).sum(),
        lengths=_count(jnp.where(done, lengths, 0), returns),
        count=_count(done, returns),
        nonfinite=_count(after.metrics["nonfinite"], returns),
        **_troubles(after.solves, returns),
    )
    after = after.replace(solves=None)  # counted, and not carried on
    actors = Actors(after, jnp.where(done, 0, returns), jnp.where(done, 0, lengths))
    return actors, (experience, episodes)


def _troubles(solves: Solves | None, like: Float[Array, "n"]) -> dict[str, Array]:
    """Numbers of environments with lost contacts and unconverged solves; 0 if not reported."""
    if solves is None:
        return dict.fromkeys(("lost_contacts", "unconverged"), jnp.zeros((), like.dtype))
    return {
        "lost_contacts": _count(solves.lost_contacts > 0, like),
        "unconverged": _count(solves.unconverged, like),
    }


def _count(which: Array, like: Float[Array, "n"]) -> Float[Array, ""]:
    """The sum, in the type of `like`."""
    return which.sum().astype(like.dtype)


def _join_chunks(x):
    """(chunks, T, lanes, ...) to (T, chunks * lanes, ...)."""
    chunks, steps, lanes, *rest = x.shape
    return jnp.swapaxes(x, 0, 1).reshape(steps, chunks * lanes, *rest)
