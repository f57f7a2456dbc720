"""`batch_rollout`: rollouts of many environments, on all devices and in chunks."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float

from jaxsim.arrays import tuning
from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.arrays.constant import Constant
from jaxsim.arrays.memo import is_traced, once_for_each
from jaxsim.batching.mapping import vmap
from jaxsim.dynamics.components import motion_components
from jaxsim.engine.status import Status
from jaxsim.engine.stepping import scan_steps, step_with_status
from jaxsim.lanes.switch import lanes_enabled
from jaxsim.model import Model, State
from jaxsim.model.facts import Constants
from jaxsim.model.inputs import admit, admit_array, admit_model
from jaxsim.parallel.chunks import chunk_lanes, map_chunks
from jaxsim.parallel.devices import EVERYWHERE, SPLIT, device_mesh, everywhere, parallel, split


def batch_rollout(
    model: Model,
    states: State,
    ctrls: Float[Array, "B T nu"],
    observe: Callable[[State], Any] | None = None,
    *,
    status: bool = False,
) -> State | tuple[State, Any] | tuple[State, Any, Status]:
    """Simulate a batch of environments over sequences of controls.

    The batch is divided among all devices, and on a CPU into chunks that fit in the cache. On a
    CPU, call `jaxsim.configure_cpu()` before JAX is used, as the command line does. Inside
    `jax.jit`, `jax.grad` and other transformations, the rollout is part of their program on one
    device, and reverse mode stores the same as with `jaxsim.checkpoint`.

    Args:
      model: the model, shared by all environments.
      states: states with a leading batch axis.
      ctrls: (B, T, nu) controls of each environment and step.
      observe: function of the state of one environment, evaluated after each step.
      status: whether to return the combined status of each environment's solves, too.

    Returns:
      The final states; with `observe`, also its results with leading axes (B, T); with `status`,
      also the status of each environment.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: shapes do not fit together.
    """
    model = admit_model(model)
    ctrls = admit_array(model, ctrls, (None, None, model.nu), "ctrls")
    model, states, _ = admit(model, states, batch=ctrls.shape[:1])
    alone = functools.partial(_part_of_a_program, model, states, ctrls, observe, status)
    if is_traced((model, states, ctrls)):
        return _asked_for(alone(), observe, status)
    mesh = device_mesh(jax.local_devices())
    batch = ctrls.shape[0]
    padded = -(-batch // mesh.size) * mesh.size
    pad = functools.partial(_pad, rows=padded - batch)
    states, ctrls = split(jax.tree.map(pad, (states, ctrls)), mesh)
    if is_traced(ctrls):  # within `jax.jit` everything is
        return _asked_for(alone(), observe, status)
    if lanes_enabled() and _first_numbers(known := _constant(model)):
        found = _compiled_kernels(observe, status, mesh, known)(states, ctrls)
    else:
        run = _compiled(observe, status, mesh, Constants.of(model, motion_components.leaves))
        found = run(everywhere(model, mesh), states, ctrls)
    if padded > batch:
        found = jax.tree.map(lambda x: x[:batch], found)
    return _asked_for(found, observe, status)


def _asked_for(found, observe, status: bool):
    """The requested ones of final states, observations and statuses."""
    asked = [x for x, wanted in zip(found, (True, observe, status), strict=True) if wanted]
    return tuple(asked) if len(asked) > 1 else asked[0]


@functools.lru_cache(maxsize=16)
def _compiled(observe, status: bool, mesh: Mesh, constants: Constants):
    """The rollout of all chunks on all devices; one compilation for each model structure.

    The axes of the joints are constants of the program, so that planar models are recognised.
    """
    platform = mesh.devices.flat[0].platform

    def shard(model, states, ctrls):
        model = constants.put_into(model)
        run = _run(functools.partial(step_with_status, model), observe, status)
        return _on_one_device(model, run, states, ctrls, platform)

    return parallel(shard, mesh, (EVERYWHERE, SPLIT, SPLIT), SPLIT)


@once_for_each
def _constant(model: Model) -> Constant:
    return Constant(jax.tree.map(lambda x: x, model))  # not the model itself, see `once_for_each`


@functools.lru_cache(maxsize=16)
def _compiled_kernels(observe, status: bool, mesh: Mesh, known: Constant):
    """The rollout with one kernel for each step; one compilation for each model."""
    model = known.value

    def shard(states, ctrls):
        run = _run(functools.partial(step_with_status, model), observe, status)
        return vmap(run)(states, ctrls)

    return parallel(shard, mesh, (SPLIT, SPLIT), SPLIT)


@functools.lru_cache(maxsize=64)
def _numbers_of(structure) -> list[Constant]:
    """The first model of a structure; the list is filled by `_first_numbers`."""
    return []


def _first_numbers(known: Constant) -> bool:
    """Whether no model of the same structure with other numbers came before.

    Whoever changes the numbers of a model gets a program for all numbers instead of a kernel for
    each.
    """
    first = _numbers_of(known.structure)
    if not first:
        first.append(known)
    return first[0] == known


def _part_of_a_program(model: Model, states: State, ctrls, observe, status: bool):
    run = _run(checkpoint(functools.partial(step_with_status, model)), observe, status)
    return _on_one_device(model, run, states, ctrls, jax.default_backend())


def _run(advance, observe, status: bool):
    """The rollout of one environment."""
    observe = observe or (lambda state: ())
    return functools.partial(scan_steps, advance, observe, status)


def _on_one_device(model: Model, run, states: State, ctrls, platform: str):
    batched = vmap(run)
    limit = chunk_lanes(model)
    if platform != "cpu" or ctrls.shape[0] <= limit:
        return batched(states, ctrls)
    return _chunked(batched, states, ctrls, limit)


def _chunked(f, states, ctrls, limit: int):
    """`lax.map` over equal chunks of whole vectors; the last chunk is padded with copies."""
    lanes = ctrls.shape[0]
    chunks = -(-lanes // limit)
    size = -(-lanes // (chunks * tuning.VECTOR)) * tuning.VECTOR
    padded = jax.tree.map(lambda x: _pad(x, chunks * size - lanes), (states, ctrls))
    return jax.tree.map(lambda x: x[:lanes], map_chunks(f, size, *padded))


def _pad(x, rows: int):
    """Append copies of the last row."""
    if rows == 0:
        return x
    return jnp.concatenate([x, jnp.broadcast_to(x[-1:], (rows, *x.shape[1:]))])
