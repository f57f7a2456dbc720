"""`vmap` with the batch on the last axis while it evaluates.

`jax.vmap` puts the batch first, and XLA's CPU loops then run over axes of length 3 or 6. Here
the function is traced for one element and evaluated with the batch last (see `interpret`), so
every loop runs over the batch at full vector width, and small matrix products become fused
multiply-adds. The meaning is that of `jax.vmap`: axes, pytrees, random numbers, custom
derivatives and errors are the same; numbers are the same up to rounding.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxsim.batching import forms, jaxprs, primitives  # noqa: F401
from jaxsim.batching.interpret import Lanes


def vmap(
    f: Callable, in_axes: Any = 0, out_axes: Any = 0, axis_size: int | None = None
) -> Callable:
    """Vectorise a function as `jax.vmap` does, but compute with the batch on the last axis.

    Like `jax.vmap` it compiles nothing by itself: use `jax.jit(vmap(f))`, or `vmap(jax.jit(f))`.

    Args:
        f: Function of pytrees of arrays, written for one element.
        in_axes: Axis to map of every positional argument: an int, None for "not mapped", or a
            tuple with one entry for each argument, each a tree prefix of it. Keyword arguments
            are mapped along axis 0.
        out_axes: Position of the mapped axis in the result, as a tree prefix of it; None for
            results that do not depend on the batch.
        axis_size: Size of the batch, needed only if no argument is mapped.

    Returns:
        A function with the same signature on arrays with an additional axis.

    Raises:
        TypeError: An axis is not an int, or `f` is not callable.
        ValueError: The axes do not fit the arguments or the result.
    """
    if not callable(f):
        raise TypeError(f"vmap needs a callable, got {f!r}")
    in_axes = tuple(in_axes) if isinstance(in_axes, list) else in_axes
    if not (in_axes is None or type(in_axes) in (int, tuple)):
        raise TypeError(
            "vmap in_axes must be an int, None, or a tuple with one entry for each positional "
            f"argument, but got {in_axes!r}"
        )
    _check_axes("in_axes", in_axes)
    _check_axes("out_axes", out_axes)

    @functools.wraps(f)
    def batched(*args, **kwargs):
        leaves, tree = jax.tree.flatten((args, kwargs))
        axes = _input_axes(in_axes, args, kwargs)
        axes = [_canonical(axis, leaf) for axis, leaf in zip(axes, leaves, strict=True)]
        lanes = Lanes(_batch_size(leaves, axes, axis_size))
        program, out_tree = _trace(f, leaves, axes, tree)
        mapped = [
            jnp.moveaxis(leaf, axis, -1)
            for leaf, axis in zip(leaves, axes, strict=True)
            if axis is not None
        ]
        results, flags = lanes.evaluate(program, mapped, [True] * len(mapped))
        places = _broadcast_prefix("out_axes", out_axes, jax.tree.unflatten(out_tree, results))
        results = [
            _place(lanes, value, flag, place)
            for value, flag, place in zip(results, flags, places, strict=True)
        ]
        return jax.tree.unflatten(out_tree, results)

    return batched


def _trace(f, leaves, axes, tree) -> tuple[forms.Program, Any]:
    """Trace f for one element; leaves that are not mapped are closed over and stay concrete."""

    def one_element(*mapped):
        rest = iter(mapped)
        given = [
            leaf if axis is None else next(rest) for leaf, axis in zip(leaves, axes, strict=True)
        ]
        args, kwargs = jax.tree.unflatten(tree, given)
        return f(*args, **kwargs)

    kinds = [
        jaxprs.element(x, axis) for x, axis in zip(leaves, axes, strict=True) if axis is not None
    ]
    traced, shapes = jax.make_jaxpr(one_element, return_shape=True)(*kinds)
    return forms.program(traced), jax.tree.structure(shapes)


def _check_axes(name: str, axes) -> None:
    for leaf in jax.tree.leaves(axes):
        if type(leaf) is not int:
            raise TypeError(f"vmap {name} must be ints or None in nested containers, got {leaf!r}")


def _input_axes(in_axes, args, kwargs) -> list[int | None]:
    """One axis for each leaf of (args, kwargs)."""
    if isinstance(in_axes, tuple) and len(in_axes) != len(args):
        raise ValueError(
            "vmap in_axes must have one entry for each positional argument, but got "
            f"len(in_axes)={len(in_axes)}, len(args)={len(args)}"
        )
    return _broadcast_prefix("in_axes", in_axes, args) + [0] * len(jax.tree.leaves(kwargs))


def _broadcast_prefix(name: str, prefix, tree) -> list[int | None]:
    """One axis for each leaf of the tree; in the prefix, None counts as an axis, not as no leaf."""
    unmapped = object()
    marked = jax.tree.map(
        lambda x: unmapped if x is None else x, prefix, is_leaf=lambda x: x is None
    )
    try:
        axes = jax.tree.leaves(jax.tree.broadcast(marked, tree))
    except ValueError as error:
        raise ValueError(
            f"vmap {name} specification must be a tree prefix of the corresponding value: {error}"
        ) from None
    return [None if axis is unmapped else axis for axis in axes]


def _canonical(axis: int | None, leaf) -> int | None:
    if axis is None:
        return None
    shape = jax.typeof(leaf).shape
    if not -len(shape) <= axis < len(shape):
        needed = -axis if axis < 0 else axis + 1
        raise ValueError(
            f"vmap was requested to map its argument along axis {axis}, which implies that its "
            f"rank should be at least {needed}, but is only {len(shape)} (its shape is {shape})"
        )
    return axis % len(shape)


def _batch_size(leaves, axes, axis_size: int | None) -> int:
    sizes = {
        jax.typeof(leaf).shape[axis]
        for leaf, axis in zip(leaves, axes, strict=True)
        if axis is not None
    }
    if axis_size is not None:
        sizes.add(axis_size)
    if not leaves and not sizes:
        raise ValueError("vmap needs an argument that contains an array, or axis_size")
    if not sizes:
        raise ValueError("vmap needs an in_axes entry that is not None, or axis_size")
    if len(sizes) > 1:
        raise ValueError(
            "vmap got inconsistent sizes for array axes to be mapped (or axis_size): "
            f"{sorted(sizes)}"
        )
    return sizes.pop()


def _place(lanes: Lanes, value, flag: bool, axis: int | None):
    """Move the lane axis to the position that `out_axes` asks for."""
    if axis is None:
        if flag:
            raise ValueError("vmap out_axes is None for a result that depends on the batch")
        return jnp.asarray(value)
    value = lanes.broadcast(value, flag)
    if not -value.ndim <= axis < value.ndim:
        raise ValueError(
            f"vmap out_axes {axis} is out of bounds for a result of dimension {value.ndim}"
        )
    return jnp.moveaxis(value, -1, axis)
