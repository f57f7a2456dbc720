"""Operands of rules with the lane axis that a primitive needs."""

from collections.abc import Sequence

import jax.numpy as jnp
from jax import lax


def broadcast_unless_scalar(value, flag: bool, shape: Sequence[int]):
    """Broadcast an operand to a shape whose last axis is the batch.

    Unbatched scalars stay scalars, which primitives accept.
    """
    rank = jnp.ndim(value)
    if (jnp.shape(value) == tuple(shape) and flag) or rank == 0:
        return value
    axes = [*range(rank - 1), len(shape) - 1] if flag else range(rank)
    return lax.broadcast_in_dim(value, tuple(shape), axes)


def broadcast_full(value, flag: bool, shape: Sequence[int]):
    """Broadcast an operand to a shape whose last axis is the batch, scalars included."""
    value = broadcast_unless_scalar(value, flag, shape)
    full = jnp.ndim(value) == len(shape)
    axes = (len(shape) - 1,) if flag else ()
    return value if full else lax.broadcast_in_dim(value, tuple(shape), axes)


def all_full(lanes, values, flags) -> list:
    """The values, each with a lane axis."""
    return [lanes.broadcast(v, f) for v, f in zip(values, flags, strict=True)]


def bind(eqn, *values) -> list:
    """The equation's primitive with its parameters, as a function of operands."""
    results = eqn.primitive.bind(*values, **eqn.params)
    return list(results) if eqn.primitive.multiple_results else [results]


def same_axes(lanes, eqn, values, flags):
    """Primitives whose parameters name axes from the front: reductions, sorts, scans."""
    return bind(eqn, *all_full(lanes, values, flags))


def all_as(lanes, values, flags, wanted) -> list:
    """The values, those in `wanted` with a lane axis."""
    return [lanes.broadcast(v, f or not w) for v, f, w in zip(values, flags, wanted, strict=True)]


def select_lanes(which, cases):
    """Select a case for each lane; `which` has only the lane axis."""
    which = lax.broadcast_in_dim(which, cases[0].shape, (cases[0].ndim - 1,))
    return lax.select_n(which, *cases)
