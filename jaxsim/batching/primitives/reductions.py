"""Reductions, and other primitives whose parameters number axes from the front.

XLA does not vectorise a reduction of leading axes, so short ones are unrolled.
"""

import functools
import itertools
import math
from collections.abc import Sequence

import jax.numpy as jnp
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.batching.primitives.derivatives import with_jvp
from jaxsim.batching.primitives.jvp_rule import with_jvp_rule
from jaxsim.batching.primitives.operands import same_axes
from jaxsim.batching.primitives.own_kernel import own_kernel
from jaxsim.batching.registry import register


def reduce_sum(lanes, eqn, values, flags):
    """A sum; unrolled for real numbers, with the derivative of a sum for floats."""
    if jnp.issubdtype(values[0].dtype, jnp.complexfloating):
        return same_axes(lanes, eqn, values, flags)
    whole = jnp.issubdtype(values[0].dtype, jnp.integer)
    total = functools.partial(_combined, lax.add) if whole else _sum
    return reduction(total, lanes, eqn, values, flags)


def extremum(operator, lanes, eqn, values, flags):
    """A maximum or minimum, with the primitive's derivative, which equal entries share."""
    combined = functools.partial(_combined, operator)
    if not jnp.issubdtype(values[0].dtype, jnp.inexact):
        return reduction(combined, lanes, eqn, values, flags)
    run = lambda *xs: reduction(combined, lanes, eqn, xs, flags)  # noqa: E731
    return with_jvp(lanes, eqn, flags, run)(*values)


def reduction(combined, lanes, eqn, values, flags):
    """A reduction by `combined` if it is short, else by the primitive."""
    axes = tuple(eqn.params["axes"])
    terms = math.prod(values[0].shape[a] for a in axes)
    if terms == 1:
        return [lax.squeeze(values[0], axes)]
    if not 0 < terms <= tuning.REDUCED_ENTRIES:
        return same_axes(lanes, eqn, values, flags)
    return [combined(values[0], axes)]


def _combined(operator, x, axes: tuple[int, ...]):
    """Combine all entries along some axes; the operand is computed before it, behind a barrier."""
    return own_kernel(_written_out, x, axes=axes, operator=operator)


def _sum(x, axes: tuple[int, ...]):
    """A sum by `_combined`, with a derivative."""

    def rule(primals, tangents):
        # The derivative uses the plain sum: its transpose is a broadcast, that of slices many pads.
        return [_sum(primals[0], axes)], [jnp.sum(tangents[0], axes)]

    return with_jvp_rule(lambda x: [_combined(lax.add, x, axes)], rule)(x)[0]


def _written_out(x, *, axes: tuple[int, ...], operator):
    for first, last in reversed(_runs(axes)):
        size = math.prod(x.shape[first : last + 1])
        x = x.reshape(*x.shape[:first], size, *x.shape[last + 1 :])
        x = lax.squeeze(_reduced(x, first, operator), [first])
    return x


def _runs(axes: Sequence[int]) -> list[tuple[int, int]]:
    """First and last axis of each run of consecutive axes."""
    runs = itertools.groupby(enumerate(sorted(axes)), lambda place: place[1] - place[0])
    runs = [[axis for _, axis in run] for _, run in runs]
    return [(run[0], run[-1]) for run in runs]


def _reduced(x, axis: int, operator):
    """Reduce an axis to size one, `REDUCED_AT_ONCE` slices at a time."""
    size = x.shape[axis]
    if size == 1:
        return x
    parts = min(size, tuning.REDUCED_AT_ONCE)
    length = size // parts
    edges = [*range(0, (parts + 1) * length, length), *range(parts * length + 1, size + 1)]
    slices = [lax.slice_in_dim(x, a, b, axis=axis) for a, b in itertools.pairwise(edges)]
    total = _reduced(functools.reduce(operator, slices[:parts]), axis, operator)
    return functools.reduce(operator, slices[parts:], total)


def _no_floats(eqn) -> bool:
    """Whether the operands are no floats; XLA calls a library for floats, as no section can."""
    return "float" not in eqn.invars[0].aval.dtype.name


register("argmax", "argmin", rule=same_axes)
register("reduce_prod", "reduce_xor", "sort", rule=same_axes)
register("cumlogsumexp", "cummax", "cummin", "cumprod", rule=same_axes)
register("cumsum", rule=same_axes, in_section=_no_floats)
register("reduce_sum", rule=reduce_sum, in_section=_no_floats)
for name, operator in (("reduce_max", lax.max), ("reduce_min", lax.min)):
    register(name, rule=functools.partial(extremum, operator), in_section=_no_floats)
for name, operator in (("reduce_and", lax.bitwise_and), ("reduce_or", lax.bitwise_or)):
    combined = functools.partial(_combined, operator)
    register(name, rule=functools.partial(reduction, combined), in_section=True)
