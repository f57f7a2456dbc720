"""One step of a batch under each of Gymnasium's autoreset modes."""

import functools
from collections.abc import Callable
from typing import Any

import jax
from flax import struct
from gymnasium.vector import AutoresetMode
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float

from jaxsim.batching import vmap
from jaxsim.envs.base.env import Env
from jaxsim.envs.bridges.batch import Batch, reset_where, restart, step_all
from jaxsim.envs.bridges.constant import Constant, programs_of
from jaxsim.envs.bridges.spaces import public_info
from jaxsim.envs.bridges.words import Words
from jaxsim.parallel.devices import SPLIT, parallel


@struct.dataclass
class Outcome:
    """The results of a step for the user, batch first.

    Attributes:
      obs: observations, of new episodes where one has just started.
      reward: rewards of the step.
      terminated: whether the task ended in this step.
      truncated: whether the episode was truncated in this step.
      info: metrics that belong to `obs`.
      final_obs: with SAME_STEP the observations before any reset.
      final_info: with SAME_STEP the metrics before any reset.
    """

    obs: Float[Array, "n nobs"]
    reward: Float[Array, "n"]
    terminated: Bool[Array, "n"]
    truncated: Bool[Array, "n"]
    info: dict[str, Array]
    final_obs: Any = None
    final_info: Any = None


def start(env: Env, keys: Array) -> Batch:
    """All environments at the start of an episode."""
    return Batch(*vmap(functools.partial(restart, env))(keys))


def next_step(env: Env, batch: Batch, actions, done) -> tuple[Batch, Outcome]:
    """NEXT_STEP: an episode that ended in the last step is reset in this one, without action."""
    stepped = batch.replace(states=step_all(env, batch.states, actions))
    batch = reset_where(env, stepped, done)
    return batch, _outcome(batch)


def same_step(env: Env, batch: Batch, actions, done) -> tuple[Batch, Outcome]:
    """SAME_STEP: an episode that ends is reset at once; its last observation is returned, too."""
    del done  # nothing is left over from the last step
    stepped = batch.replace(states=step_all(env, batch.states, actions))
    last = _outcome(stepped)
    batch = reset_where(env, stepped, last.terminated | last.truncated)
    obs, info = batch.states.obs, public_info(batch.states)
    return batch, last.replace(obs=obs, info=info, final_obs=last.obs, final_info=last.info)


def disabled(env: Env, batch: Batch, actions, done) -> tuple[Batch, Outcome]:
    """DISABLED: the user resets environments."""
    del done
    batch = batch.replace(states=step_all(env, batch.states, actions))
    return batch, _outcome(batch)


def _outcome(batch: Batch) -> Outcome:
    s = batch.states
    return Outcome(s.obs, s.reward, s.terminated, s.truncated, public_info(s))


_MODES: dict[AutoresetMode, Callable] = {
    AutoresetMode.NEXT_STEP: next_step,
    AutoresetMode.SAME_STEP: same_step,
    AutoresetMode.DISABLED: disabled,
}


@programs_of
def compiled_start(constant: Constant, mesh: Mesh) -> Callable:
    """`keys -> Batch` on the devices of the mesh."""
    return parallel(functools.partial(start, constant.value), mesh, (SPLIT,), SPLIT)


@programs_of
def compiled_reset(constant: Constant, mesh: Mesh) -> Callable:
    """`(batch, mask) -> Batch`."""
    return parallel(functools.partial(reset_where, constant.value), mesh, (SPLIT, SPLIT), SPLIT)


@programs_of
def compiled_step(constant: Constant, mesh: Mesh, mode: AutoresetMode) -> Callable:
    """`(batch, actions, done) -> (Batch, Outcome)`."""
    step = functools.partial(_MODES[mode], constant.value)
    return parallel(step, mesh, (SPLIT, SPLIT, SPLIT), SPLIT)


@programs_of
def compiled_step_for_host(
    constant: Constant, mesh: Mesh, mode: AutoresetMode
) -> tuple[Callable, Words]:
    """`(batch, actions, done) -> (Batch, words, last)`, and what the words mean.

    The words are those of an `Outcome` of each environment, as each array that is brought to the
    host costs tens of microseconds. `last`, with SAME_STEP, are those before any reset.
    """
    step, layout = functools.partial(_MODES[mode], constant.value), _words(constant.value)
    packed = jax.vmap(layout.packed)

    def run(batch, actions, done):
        batch, found = step(batch, actions, done)
        now, last = found.replace(final_obs=None, final_info=None), None
        if found.final_obs is not None:
            last = packed(now.replace(obs=found.final_obs, info=found.final_info))
        return batch, packed(now), last

    return parallel(run, mesh, (SPLIT, SPLIT, SPLIT), SPLIT), layout


def _words(env: Env) -> Words:
    """The words of one environment's `Outcome`."""
    begin = lambda key: _outcome(Batch(*restart(env, key)))  # noqa: E731
    return Words.of(jax.eval_shape(begin, jax.random.key(0)))
