"""Products of small arrays, lanes last: sums of elementwise multiply-adds.

A 6x6 product for 256 lanes is six fused multiply-adds over arrays of shape (6, 6, 256), which
XLA runs at full vector width; as `dot_general` it would be 256 tiny products with the batch in
front. Times on one core (AVX-512, float32, 256 lanes) put the limits where they are: unrolled
against `dot_general` of the transposed arrays, (12,12)x(12,12) takes 37 us against 87, (27,27)x(27,)
18 against 109, (27,27)x(27,27) 280 against 350, but (8,128)x(128,8) 7600 against 390. With one
operand shared by all lanes the batch is a free axis of one real matrix product, as fast from
8 terms on and then faster.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import lax

MAX_TERMS = 32  # of one unrolled sum, both operands batched
MAX_TERMS_VECTOR = 64  # the same where the result has at most as many entries as an operand
MAX_TERMS_SHARED = 8  # of one unrolled sum, one operand shared by all lanes
MAX_PRODUCTS = 32768  # multiplications for one lane


@dataclass(frozen=True)
class Axes:
    """The axes of one operand: contracted, in common with the other, and free."""

    shape: tuple[int, ...]
    contracted: tuple[int, ...]
    common: tuple[int, ...]

    @property
    def free(self) -> tuple[int, ...]:
        """The remaining axes, in order."""
        taken = self.contracted + self.common
        return tuple(i for i in range(len(self.shape)) if i not in taken)

    def size(self, axes: Sequence[int]) -> int:
        """Number of entries along these axes."""
        return math.prod(self.shape[i] for i in axes)


def dot_general(lanes, eqn, values, flags):
    """Unrolled, or one matrix product with the lanes as a free axis, or left to `jax.vmap`."""
    p = eqn.params
    (lc, rc), (lb, rb) = p["dimension_numbers"]
    left = Axes(eqn.invars[0].aval.shape, tuple(lc), tuple(lb))
    right = Axes(eqn.invars[1].aval.shape, tuple(rc), tuple(rb))
    if p.get("out_sharding") is not None:
        return None
    dtype = eqn.outvars[0].aval.dtype
    if _unrolls(left, right, all(flags)) and _is_wide(dtype, *(v.aval.dtype for v in eqn.invars)):
        return [multiply_add(lanes, values, flags, (left, right), dtype)]
    if all(flags):
        return None
    return [_lanes_as_free_axis(values, flags, (left, right), p)]


def multiply_add(lanes, values, flags, axes: tuple[Axes, Axes], dtype):
    """Sum over the contracted index of broadcast products."""
    left, right = axes
    common, nl = len(left.common), len(left.free)
    sizes = [left.shape[i] for i in left.common + left.free]
    sizes += [right.shape[i] for i in right.free]
    shape = (*sizes, lanes.size)
    l_axes = tuple(range(common + nl))
    r_axes = (*range(common), *range(common + nl, len(sizes)))
    total = None
    for k in np.ndindex(*(left.shape[i] for i in left.contracted)):
        l_term = _term(values[0], flags[0], left, k, l_axes, shape, dtype)
        r_term = _term(values[1], flags[1], right, k, r_axes, shape, dtype)
        product = lax.bitwise_and(l_term, r_term) if dtype == bool else lax.mul(l_term, r_term)
        total = product if total is None else _add(total, product)
    return jnp.zeros(shape, dtype) if total is None else total


def _term(value, flag, axes: Axes, k, out_axes, shape, dtype):
    """The slice at contracted index k, its axes laid out as those of the result."""
    start, limit = [0] * jnp.ndim(value), list(jnp.shape(value))
    for axis, i in zip(axes.contracted, k, strict=True):
        start[axis], limit[axis] = i, i + 1
    term = lax.squeeze(lax.slice(value, start, limit), axes.contracted)
    kept = [i for i in range(len(axes.shape)) if i not in axes.contracted]
    order = [kept.index(i) for i in axes.common + axes.free]
    if flag:
        order, out_axes = [*order, len(order)], (*out_axes, len(shape) - 1)
    if order != sorted(order):
        term = lax.transpose(term, order)
    return lax.broadcast_in_dim(lax.convert_element_type(term, dtype), shape, out_axes)


def _lanes_as_free_axis(values, flags, axes: tuple[Axes, Axes], p):
    """`dot_general` puts the free axes of its right operand last: make that the batched one."""
    options = {k: p[k] for k in ("precision", "preferred_element_type")}
    contracted, common = p["dimension_numbers"]
    if flags[1]:
        return lax.dot_general(*values, (contracted, common), **options)
    swapped = (tuple(contracted[::-1]), tuple(common[::-1]))
    out = lax.dot_general(values[1], values[0], swapped, **options)
    b, nl, nr = len(axes[0].common), len(axes[0].free), len(axes[1].free)
    order = [*range(b), *range(b + nr, b + nr + nl), *range(b, b + nr), b + nr + nl]
    return lax.transpose(out, order)


def _unrolls(left: Axes, right: Axes, both: bool) -> bool:
    terms = left.size(left.contracted)
    free = left.size(left.free), right.size(right.free)
    if terms * math.prod(free) > MAX_PRODUCTS:
        return False
    if not both:
        return terms <= MAX_TERMS_SHARED
    return terms <= (MAX_TERMS_VECTOR if min(free) == 1 else MAX_TERMS)


def _is_wide(*dtypes) -> bool:
    """Types that can be summed as they are; narrow floats want a wider accumulator."""
    return all(not jnp.issubdtype(d, jnp.floating) or jnp.finfo(d).bits >= 32 for d in dtypes)


def _add(a, b):
    return lax.bitwise_or(a, b) if a.dtype == bool else lax.add(a, b)
