"""Products of small arrays with lanes last, as sums of elementwise multiply-adds.

A 6x6 product for 256 lanes is six fused multiply-adds of arrays of shape (6, 6, 256), which XLA
runs at full vector width. As a `dot_general` it would be 256 tiny products with the batch in front.
`jaxsim.arrays.tuning` has the sizes up to which unrolling is faster. If all lanes share one
operand, the batch is a free axis of one large matrix product.

The product is a primitive, `lane_contract`, which is unrolled when it is lowered. So its
derivatives are such products, too, and not the transposes of unrolled sums, for grad(vmap(f)) as
well as for vmap(grad(f)).
"""

import functools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir

from jaxsim.arrays import tuning
from jaxsim.batching import jaxprs
from jaxsim.batching.lazy import LazyTranspose
from jaxsim.batching.primitives.own_kernel import not_inlined
from jaxsim.batching.registry import register

Labels = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]  # left, right, result

contract_p = jex.Primitive("lane_contract")


def dot_general(lanes, eqn, values, flags):
    """A `dot_general` as a product with labelled axes, in which lanes are one more label."""
    p = eqn.params
    dtypes = [v.aval.dtype for v in (*eqn.invars, *eqn.outvars)]
    if jaxprs.is_divided(p.get("out_sharding")) or not all(_is_wide(d) for d in dtypes):
        return None
    left, right, out = _labels(p["dimension_numbers"], [v.aval.ndim for v in eqn.invars])
    lane = len(left) + len(right)
    groups = [left + (lane,) * flags[0], right + (lane,) * flags[1]]
    for i, v in enumerate(values):
        if isinstance(v, LazyTranspose):
            values[i], groups[i] = v.array, v.labels(groups[i])
    x, y = (lax.convert_element_type(v, dtypes[-1]) for v in values)
    return [contract(x, y, (*groups, (*out, lane)), p["precision"])]


def nested(lanes, eqn, values, flags):
    """A product of an inner `vmap`, with one more axis of lanes."""
    left, right, out = eqn.params["labels"]
    lane = 1 + max((*left, *right))
    labels = left + (lane,) * flags[0], right + (lane,) * flags[1], (*out, lane)
    return [contract(values[0], values[1], labels, eqn.params["precision"])]


def contract(x, y, labels: Labels, precision: Any = None):
    """Sum over all labels that are not in the result, as `einsum`; both operands must have them."""
    x, y = jaxprs.match_varying(x, y)
    return contract_p.bind(x, y, labels=labels, precision=precision)


def evaluate(x, y, *, labels: Labels, precision, call: bool = False):
    """The product, unrolled if that is faster, possibly in two halves, else one `dot_general`."""
    sizes = _sizes(x, y, labels)
    if not _unrolls(labels, sizes):
        parts = _halves(x, y, labels, sizes)
        if parts:
            both = [evaluate(*p, labels=labels, precision=precision, call=call) for p in parts]
            return both[0] + both[1]
        return _matrix_product(x, y, labels, precision)
    if call and _products(labels, sizes) >= tuning.PRODUCT_CALL and _terms(labels, sizes) > 1:
        with not_inlined():
            return _unrolled_call(x, y, labels=labels)
    return unrolled(x, y, labels=labels)


def is_written_out(eqn) -> bool:
    """Whether the product is unrolled without any `dot_general`."""
    labels = eqn.params["labels"]
    x, y = (v.aval for v in eqn.invars)
    sizes = _sizes(x, y, labels)
    return _unrolls(labels, sizes) or bool(_middle(labels, sizes))


def unrolled(x, y, *, labels: Labels):
    """Sum over the contracted indices of broadcast products."""
    left, right, out = labels
    sizes = _sizes(x, y, labels)
    summed = [i for i in left if i not in out]
    shape = tuple(sizes[i] for i in out)
    total = None
    for index in np.ndindex(*(sizes[i] for i in summed)):
        at = dict(zip(summed, index, strict=True))
        product = _spread(x, left, at, out, shape) * _spread(y, right, at, out, shape)
        total = product if total is None else total + product
    return jnp.zeros(shape, x.dtype) if total is None else total


_unrolled_call = jax.jit(unrolled, static_argnames="labels")


def _halves(x, y, labels: Labels, sizes):
    """The operands divided in the middle of a sum, if both halves are then unrolled."""
    found = _middle(labels, sizes)
    if not found:
        return []
    (cut, middle), (left, right, _) = found, labels
    ends = (0, middle), (middle, sizes[cut])
    parts = (
        [lax.slice_in_dim(v, *end, axis=group.index(cut)) for end in ends]
        for v, group in ((x, left), (y, right))
    )
    return list(zip(*parts, strict=True))


def _middle(labels: Labels, sizes) -> tuple[int, int] | None:
    """The label to divide and its middle, if both halves are then unrolled."""
    left, _, out = labels
    summed = [i for i in left if i not in out]
    if not summed or not _is_batched(labels):
        return None
    cut = max(summed, key=sizes.__getitem__)
    middle = sizes[cut] // 2
    fits = all(_unrolls(labels, sizes | {cut: n}) for n in (middle, sizes[cut] - middle))
    return (cut, middle) if fits else None


def _spread(value, labels: Sequence[int], at: dict[int, int], out: Sequence[int], shape):
    """The slice of an operand at the contracted indices, with axes in the result's order."""
    start = [at.get(i, 0) for i in labels]
    limit = [at[i] + 1 if i in at else n for i, n in zip(labels, value.shape, strict=True)]
    part = lax.squeeze(lax.slice(value, start, limit), [a for a, i in enumerate(labels) if i in at])
    places = [out.index(i) for i in labels if i not in at]
    if places != sorted(places):
        part = lax.transpose(part, sorted(range(len(places)), key=places.__getitem__))
    return lax.broadcast_in_dim(part, shape, sorted(places))


def _matrix_product(x, y, labels: Labels, precision):
    """`dot_general` puts the free axes of its right operand last: make that the batched one."""
    left, right, out = labels
    if out and out[-1] in left and out[-1] not in right:
        x, y, left, right = y, x, right, left
    summed = [i for i in left if i in right and i not in out]
    common = [i for i in left if i in right and i in out]
    numbers: Any = tuple(
        tuple(tuple(operand.index(i) for i in group) for operand in (left, right))
        for group in (summed, common)
    )
    result = lax.dot_general(x, y, numbers, precision, x.dtype)
    order = common + [i for i in left if i not in right] + [i for i in right if i not in left]
    return lax.transpose(result, [order.index(i) for i in out])


def _labels(dimension_numbers, ranks) -> Labels:
    """Labels of a `dot_general`: its result is (common, left free, right free)."""
    (lc, rc), (lb, rb) = dimension_numbers
    left = tuple(range(ranks[0]))
    shared = dict(zip((*rc, *rb), (*lc, *lb), strict=True))
    right = tuple(shared.get(i, ranks[0] + i) for i in range(ranks[1]))
    free_left = tuple(i for i in left if i not in (*lc, *lb))
    return left, right, (*lb, *free_left, *(i for i in right if i not in left))


def _sizes(x, y, labels: Labels) -> dict[int, int]:
    return dict(zip(labels[0] + labels[1], x.shape + y.shape, strict=True))


def _terms(labels: Labels, sizes) -> int:
    return math.prod(sizes[i] for i in labels[0] if i not in labels[2])


def _products(labels: Labels, sizes) -> int:
    return _terms(labels, sizes) * math.prod(sizes[i] for i in labels[2][:-1])


def _unrolls(labels: Labels, sizes) -> bool:
    left, right, out = labels
    if not out or _products(labels, sizes) > tuning.PRODUCT_MULTIPLICATIONS:
        return False
    free = [math.prod(sizes[i] for i in out[:-1] if i not in other) for other in (right, left)]
    limit = tuning.PRODUCT_TERMS_VECTOR if min(free) == 1 else tuning.PRODUCT_TERMS
    return _terms(labels, sizes) <= (limit if _is_batched(labels) else tuning.PRODUCT_TERMS_SHARED)


def _is_batched(labels: Labels) -> bool:
    """Whether both operands have lanes."""
    left, right, out = labels
    return bool(out) and out[-1] in left and out[-1] in right


def _is_wide(dtype) -> bool:
    """Whether sums of this type need no wider accumulator; false for booleans."""
    if jnp.issubdtype(dtype, jnp.floating):
        return jnp.finfo(dtype).bits >= 32
    return jnp.issubdtype(dtype, jnp.number)


@functools.cache
def _result_type(x, y, labels: Labels, precision):
    """Type of the result of the equivalent `dot_general`."""
    f = functools.partial(_matrix_product, labels=labels, precision=precision)
    return jaxprs.result_type(f, x, y)


def _transpose(side: int, cotangent, x, y, *, labels: Labels, precision):
    """Cotangent of one operand: a product of the result's cotangent with the other operand."""
    kind, other = (x.aval, y) if side == 0 else (y.aval, x)
    back = labels[2], labels[1 - side], labels[side]
    return lax.convert_element_type(contract(cotangent, other, back, precision), kind.dtype)


def _batch(values, axes, *, labels: Labels, precision):
    """`jax.vmap` of the product: one more label, in front."""
    new = 1 + max((*labels[0], *labels[1], *labels[2]), default=0)

    def insert(group, axis):
        return group if axis is None else (*group[:axis], new, *group[axis:])

    left, right = (insert(group, axis) for group, axis in zip(labels, axes, strict=False))
    out = contract(values[0], values[1], (left, right, (new, *labels[2])), precision)
    return out, 0


_compiled = jax.jit(contract_p.bind, static_argnames=("labels", "precision"))
contract_p.def_impl(_compiled)
contract_p.def_abstract_eval(_result_type)
ad.defbilinear(contract_p, *(functools.partial(_transpose, side) for side in (0, 1)))
batching.primitive_batchers[contract_p] = _batch
mlir.register_lowering(contract_p, mlir.lower_fun(evaluate, multiple_results=False))
mlir.register_lowering(
    contract_p,
    mlir.lower_fun(functools.partial(evaluate, call=True), multiple_results=False),
    platform="cpu",
)

register("dot_general", rule=dot_general, takes=(LazyTranspose,))
register("lane_contract", rule=nested, in_section=is_written_out)
