"""Rollouts of many environments at once: all devices, chunks that stay in cache, batch last."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.sharding import Mesh
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.batching.memo import is_traced
from jaxsim.batching.vmap import vmap
from jaxsim.dynamics.components import motion_components
from jaxsim.engine.step import step
from jaxsim.model import Model, State
from jaxsim.model.facts import Constants
from jaxsim.parallel.chunks import VECTOR, chunk_lanes, map_chunks
from jaxsim.parallel.devices import EVERYWHERE, SPLIT, device_mesh, everywhere, parallel, split


def batch_rollout(
    model: Model,
    states: State,
    ctrls: Float[Array, "B T nu"],
    observe: Callable[[State], Any] | None = None,
) -> State | tuple[State, Any]:
    """Simulate a batch of environments over sequences of controls.

    The batch is split over all devices, and on a CPU into chunks that stay in cache. For a CPU,
    `jaxsim.configure_cpu()` should be called before JAX is used; the command line does so. Within
    `jax.jit`, `jax.grad` and the like it is part of their program, which is on one device; of its
    steps reverse mode stores what `jaxsim.checkpoint` does.

    Args:
      model: the model, shared by all environments.
      states: states with a leading batch axis.
      ctrls: controls of each environment and step.
      observe: function of the state of one environment, evaluated after each step.

    Returns:
      The final states; with `observe`, also its results with leading axes (B, T).

    Raises:
      ValueError: shapes do not fit together.
    """
    _check(model, states, ctrls)
    alone = functools.partial(_part_of_a_program, model, states, ctrls, observe)
    if is_traced((model, states, ctrls)):
        return alone()
    mesh = device_mesh(jax.local_devices())
    batch = ctrls.shape[0]
    padded = -(-batch // mesh.size) * mesh.size
    pad = functools.partial(_pad, rows=padded - batch)
    states, ctrls = split(jax.tree.map(pad, (states, ctrls)), mesh)
    if is_traced(ctrls):  # within `jax.jit` everything is
        return alone()
    run = _compiled(observe, mesh, Constants.of(model, motion_components.leaves))
    final, seen = run(everywhere(model, mesh), states, ctrls)
    final, seen = (
        jax.tree.map(lambda x: x[:batch], (final, seen)) if padded > batch else (final, seen)
    )
    return final if observe is None else (final, seen)


@functools.lru_cache(maxsize=16)
def _compiled(observe, mesh: Mesh, constants: Constants):
    """The rollout of all chunks on all devices; one compilation for each model structure.

    The directions of the joints are part of the program, so that it can be a planar one.
    """
    platform = mesh.devices.flat[0].platform

    def shard(model, states, ctrls):
        model = constants.put_into(model)
        advance = functools.partial(step, model)
        return _on_one_device(model, advance, observe, states, ctrls, platform)

    return parallel(shard, mesh, (EVERYWHERE, SPLIT, SPLIT), SPLIT)


def _part_of_a_program(model: Model, states: State, ctrls, observe) -> State | tuple[State, Any]:
    advance = checkpoint(functools.partial(step, model))
    final, seen = _on_one_device(model, advance, observe, states, ctrls, jax.default_backend())
    return final if observe is None else (final, seen)


def _on_one_device(model: Model, advance, observe, states, ctrls, platform: str):
    batched = vmap(functools.partial(_rollout, advance, observe))
    limit = chunk_lanes(model)
    if platform != "cpu" or ctrls.shape[0] <= limit:
        return batched(states, ctrls)
    return _chunked(batched, states, ctrls, limit)


def _rollout(advance, observe, state: State, ctrls: Float[Array, "T nu"]):
    def body(state, ctrl):
        state = advance(state, ctrl)
        return state, () if observe is None else observe(state)

    return lax.scan(body, state, ctrls)


def _chunked(f, states, ctrls, limit: int):
    """`lax.map` over equal chunks of whole vectors; the last one is filled up with copies."""
    lanes = ctrls.shape[0]
    chunks = -(-lanes // limit)
    size = -(-lanes // (chunks * VECTOR)) * VECTOR
    padded = jax.tree.map(lambda x: _pad(x, chunks * size - lanes), (states, ctrls))
    return jax.tree.map(lambda x: x[:lanes], map_chunks(f, size, *padded))


def _pad(x, rows: int):
    """Append copies of the last row."""
    if rows == 0:
        return x
    return jnp.concatenate([x, jnp.broadcast_to(x[-1:], (rows, *x.shape[1:]))])


def _check(model: Model, states: State, ctrls) -> None:
    if jnp.ndim(ctrls) != 3 or ctrls.shape[2] != model.nu:
        raise ValueError(
            f"ctrls must have shape (batch, steps, {model.nu}), got {jnp.shape(ctrls)}"
        )
    if jnp.ndim(states.qpos) != 2 or states.qpos.shape[0] != ctrls.shape[0]:
        raise ValueError(
            f"states.qpos must have shape ({ctrls.shape[0]}, {model.nq}) like the controls' batch, "
            f"got {jnp.shape(states.qpos)}"
        )
