"""Primitives that move or repeat numbers: axes are numbered from the front, so lanes stay last."""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import jaxprs
from jaxsim.batching.lazy import LazyTranspose
from jaxsim.batching.padded_sum import PaddedSum
from jaxsim.batching.primitives.operands import all_full, broadcast_full, same_axes
from jaxsim.batching.registry import register


def broadcast_in_dim(lanes, eqn, values, flags):
    """A broadcast, with the lane axis appended to the result."""
    p = eqn.params
    shape, axes = tuple(p["shape"]), tuple(p["broadcast_dimensions"])
    if jaxprs.is_divided(p.get("sharding")) or len(values) > 1:
        return None
    return [lax.broadcast_in_dim(values[0], (*shape, lanes.size), (*axes, len(shape)))]


def reshape(lanes, eqn, values, flags):
    """A reshape, with the lane axis unchanged."""
    p = eqn.params
    if jaxprs.is_divided(p.get("sharding")) or p.get("dimensions") is not None or len(values) > 1:
        return None
    return [lax.reshape(values[0], (*p["new_sizes"], lanes.size))]


def transpose(lanes, eqn, values, flags):
    """A transpose, with the lane axis last."""
    order = tuple(eqn.params["permutation"])
    return [LazyTranspose(values[0], (*order, len(order)))]


def slice_(lanes, eqn, values, flags):
    """A slice of the other axes; all lanes are kept."""
    p = eqn.params
    strides = p["strides"] and (*p["strides"], 1)
    start, limit = (*p["start_indices"], 0), (*p["limit_indices"], lanes.size)
    return [lax.slice(values[0], start, limit, strides)]


def pad(lanes, eqn, values, flags):
    """A pad: lazy if by zeros; if the padding value is batched, it is selected."""
    x = lanes.broadcast(values[0], flags[0])
    config = (*eqn.params["padding_config"], (0, 0, 0))
    if _is_zero(eqn.invars[1]) and all(p >= 0 and q >= 0 and r == 0 for p, q, r in config):
        shape = (*eqn.outvars[0].aval.shape, lanes.size)
        return [PaddedSum(shape, ((tuple(p for p, _, _ in config), x),))]
    if not flags[1]:
        return [lax.pad(x, values[1], config)]
    inside = lax.pad(jnp.ones(x.shape, bool), False, config)
    x = lax.pad(x, jnp.zeros((), x.dtype), config)
    return [lax.select(inside, x, broadcast_full(values[1], True, x.shape))]


def _is_zero(atom) -> bool:
    return isinstance(atom, jex.Literal) and np.ndim(atom.val) == 0 and atom.val == 0


def stack(lanes, eqn, values, flags):
    """A stack, whose new axis is numbered from the front."""
    if "axis" not in eqn.params:
        return None
    return [jnp.stack(all_full(lanes, values, flags), axis=eqn.params["axis"])]


register("broadcast_in_dim", rule=broadcast_in_dim, in_section=True)
register("reshape", rule=reshape, in_section=True)
register("transpose", rule=transpose, in_section=True)
register("slice", rule=slice_, in_section=True)
register("pad", rule=pad, in_section=True)
register("stack", rule=stack, in_section=True)
register(
    *("concatenate", "expand_dims", "rev", "split", "squeeze", "unstack"),
    rule=same_axes,
    in_section=True,
)
# Of lanes they are made or moved by other rules.
register("iota", "pcast", "pvary", "reshard", in_section=True)
