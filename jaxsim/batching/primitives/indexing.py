"""Slices, gathers and scatters with indices that may differ between lanes.

If all lanes share the indices, the lane axis is one more axis of every window. Else the lanes are
a batching dimension of `gather` and `scatter`, in the last position of operand and result, so that
only the (small) index array is transposed.
"""

import jax.numpy as jnp
from jax import lax

from jaxsim.batching.primitives.own_kernel import fusion_barrier
from jaxsim.batching.registry import register


def gather(lanes, eqn, values, flags):
    """`lax.gather`; the index vector is the last axis of the indices."""
    p = eqn.params
    return [_gather(lanes, eqn.outvars[0].aval.ndim, values, flags, p, p["dimension_numbers"])]


def _gather(lanes, rank, values, flags, p, d):
    operand, indices = values
    sizes, offset = tuple(p["slice_sizes"]), tuple(d.offset_dims)
    in_operand, in_indices = tuple(d.operand_batching_dims), tuple(d.start_indices_batching_dims)
    if flags[1]:
        indices = jnp.moveaxis(indices, -1, -2)
        if flags[0]:
            in_operand += (operand.ndim - 1,)
            in_indices += (indices.ndim - 2,)
            sizes += (1,)
    else:
        sizes, offset = (*sizes, lanes.size), (*offset, rank)
    numbers = lax.GatherDimensionNumbers(
        offset, d.collapsed_slice_dims, d.start_index_map, in_operand, in_indices
    )
    found = lax.gather(
        operand,
        indices,
        numbers,
        sizes,
        unique_indices=p["unique_indices"],
        indices_are_sorted=p["indices_are_sorted"] and not flags[1],
        mode=p["mode"],
        fill_value=p["fill_value"],
    )
    # A gather runs element by element, so XLA must not recompute it for each use.
    return fusion_barrier(found) if flags[1] else found


def scatter(lanes, eqn, values, flags):
    """`lax.scatter` and its variants: as `gather`, but the operand is always batched."""
    p, d = eqn.params, eqn.params["dimension_numbers"]
    operand, indices, updates = values
    operand, updates = lanes.broadcast(operand, flags[0]), lanes.broadcast(updates, flags[2])
    in_operand, in_indices = tuple(d.operand_batching_dims), tuple(d.scatter_indices_batching_dims)
    window = tuple(d.update_window_dims)
    if flags[1]:
        indices = jnp.moveaxis(indices, -1, -2)
        in_operand, in_indices = (*in_operand, operand.ndim - 1), (*in_indices, indices.ndim - 2)
    else:
        window += (updates.ndim - 1,)
    numbers = lax.ScatterDimensionNumbers(
        window, d.inserted_window_dims, d.scatter_dims_to_operand_dims, in_operand, in_indices
    )
    options = {**p, "dimension_numbers": numbers}
    options["indices_are_sorted"] = p["indices_are_sorted"] and not flags[1]
    return [eqn.primitive.bind(operand, indices, updates, **options)]


def dynamic_slice(lanes, eqn, values, flags):
    """A `dynamic_slice`; with different indices for each lane it is a gather."""
    sizes = tuple(eqn.params["slice_sizes"])
    operand, *start = values
    if not _plain(eqn, values):
        return None
    if not any(flags[1:]):
        # Bind the primitive: `lax.dynamic_slice` would wrap negative indices a second time.
        options = {**eqn.params, "slice_sizes": (*sizes, lanes.size)}
        return [eqn.primitive.bind(operand, *_with_zero(start), **options)]
    indices = _stack(lanes, start, flags[1:])
    axes = tuple(range(len(sizes)))
    numbers = lax.GatherDimensionNumbers(axes, (), axes)
    options = {
        "slice_sizes": sizes,
        "unique_indices": True,
        "indices_are_sorted": True,
        "mode": lax.GatherScatterMode.CLIP,
        "fill_value": None,
    }
    return [_gather(lanes, len(sizes), (operand, indices), (flags[0], True), options, numbers)]


def dynamic_update_slice(lanes, eqn, values, flags):
    """A `dynamic_update_slice`; with different indices for each lane it is a clipped scatter."""
    operand, update, *start = values
    if not _plain(eqn, values, 2):
        return None
    operand, update = lanes.broadcast(operand, flags[0]), lanes.broadcast(update, flags[1])
    if not any(flags[2:]):
        return [eqn.primitive.bind(operand, update, *_with_zero(start), **eqn.params)]
    indices = jnp.moveaxis(_stack(lanes, start, flags[2:]), -1, -2)
    axes, last = tuple(range(operand.ndim - 1)), operand.ndim - 1
    numbers = lax.ScatterDimensionNumbers(axes, (), axes, (last,), (0,))
    return [
        lax.scatter(
            operand,
            indices,
            update,
            numbers,
            indices_are_sorted=False,
            unique_indices=True,
            mode=lax.GatherScatterMode.CLIP,
        )
    ]


def _plain(eqn, values, first: int = 1) -> bool:
    """Whether the equation has one index for each axis and no dynamic sizes."""
    return len(values) - first == eqn.invars[0].aval.ndim > 0


def _with_zero(start) -> list:
    """The lane axis starts at zero, in the type of the other indices."""
    return [*start, jnp.zeros_like(start[0])]


def _stack(lanes, start, flags):
    """Indices of each lane as one array (axes, lanes)."""
    columns = [lanes.broadcast(s, f) for s, f in zip(start, flags, strict=True)]
    return jnp.stack(jnp.broadcast_arrays(*columns))


register("gather", rule=gather, in_section=True)
register("dynamic_slice", rule=dynamic_slice, in_section=True)
register("dynamic_update_slice", rule=dynamic_update_slice, in_section=True)
for kind in ("", "-add", "_add", "-mul", "_mul", "-min", "_min", "-max", "_max", "-sub", "_sub"):
    register(f"scatter{kind}", rule=scatter)
