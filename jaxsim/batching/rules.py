"""How each first-order primitive acts on arrays whose last axis is the batch.

A rule takes the lanes, the traced equation, its operands and which of them are batched, and
returns the results, all batched; None means "not this form", and `jax.vmap` of the primitive
takes over. Most primitives name their axes from the front, so a trailing axis needs little.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import contract, index, lapack, linalg, params, trigonometry
from jaxsim.batching.anywhere import anywhere
from jaxsim.batching.custom import with_jvp
from jaxsim.batching.fusion import computed, own_kernel
from jaxsim.batching.jvp_rule import with_jvp_rule
from jaxsim.batching.pieces import Pieces
from jaxsim.batching.transposed import Transposed

MAX_REDUCED = 8192  # entries of one lane whose reduction is written out
SUM_PARTS = 8  # parts that are added in one expression


def fit(value, flag: bool, shape: Sequence[int]):
    """Broadcast an operand to a full shape whose last axis is the batch.

    Scalars stay scalars where no lane axis is at stake: primitives accept them.
    """
    rank = jnp.ndim(value)
    if (jnp.shape(value) == tuple(shape) and flag) or rank == 0:
        return value
    axes = [*range(rank - 1), len(shape) - 1] if flag else range(rank)
    return lax.broadcast_in_dim(value, tuple(shape), axes)


def elementwise(lanes, eqn, values, flags):
    """Same shapes in, the same shape out."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    values = [fit(v, f, shape) for v, f in zip(values, flags, strict=True)]
    return bind(eqn, *values)


def fill(value, flag: bool, shape: Sequence[int]):
    """The same for primitives that want scalars broadcast, too."""
    value = fit(value, flag, shape)
    full = jnp.ndim(value) == len(shape)
    axes = (len(shape) - 1,) if flag else ()
    return value if full else lax.broadcast_in_dim(value, tuple(shape), axes)


def add_any(lanes, eqn, values, flags):
    """The sum of cotangents takes no scalars for arrays, but arrays that are not yet whole."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    for x, y in itertools.permutations(zip(values, flags, strict=True)):
        if isinstance(x[0], Pieces):
            return [x[0].plus(y[0] if isinstance(y[0], Pieces) else fill(*y, shape))]
    return bind(eqn, *(fill(v, f, shape) for v, f in zip(values, flags, strict=True)))


def stack(lanes, eqn, values, flags):
    """The new axis is named from the front."""
    if "axis" not in eqn.params:
        return None
    return [jnp.stack(_all(lanes, values, flags), axis=eqn.params["axis"])]


def reduce_sum(lanes, eqn, values, flags):
    """Integers have no derivative; complex numbers are left to the primitive."""
    if jnp.issubdtype(values[0].dtype, jnp.complexfloating):
        return same_axes(lanes, eqn, values, flags)
    whole = jnp.issubdtype(values[0].dtype, jnp.integer)
    total = functools.partial(_combined, lax.add) if whole else _sum
    return reduction(total, lanes, eqn, values, flags)


def extremum(operator, lanes, eqn, values, flags):
    """Only the value is ours: the derivative, which divides among equals, is the primitive's."""
    combined = functools.partial(_combined, operator)
    if not jnp.issubdtype(values[0].dtype, jnp.inexact):
        return reduction(combined, lanes, eqn, values, flags)
    run = lambda *xs: reduction(combined, lanes, eqn, xs, flags)  # noqa: E731
    return with_jvp(lanes, eqn, flags, run)(*values)


def reduction(combined, lanes, eqn, values, flags):
    """Short ones are written out: a reduction of leading axes would not be vectorised."""
    axes = tuple(eqn.params["axes"])
    terms = math.prod(values[0].shape[a] for a in axes)
    if terms == 1:
        return [lax.squeeze(values[0], axes)]
    if not 0 < terms <= MAX_REDUCED:
        return same_axes(lanes, eqn, values, flags)
    return [combined(values[0], axes)]


def _combined(operator, x, axes: tuple[int, ...]):
    """All entries along some axes, of an operand that is computed first."""
    return own_kernel(_written_out, x, axes=axes, operator=operator)


def _sum(x, axes: tuple[int, ...]):
    """The same for sums, with a derivative."""

    def rule(primals, tangents):
        # The plain reduction: its transpose is a broadcast, that of slices would be many pads.
        return [_sum(primals[0], axes)], [jnp.sum(tangents[0], axes)]

    return with_jvp_rule(lambda x: [_combined(lax.add, x, axes)], rule)(x)[0]


def _written_out(x, *, axes: tuple[int, ...], operator):
    for first, last in reversed(_runs(axes)):
        size = math.prod(x.shape[first : last + 1])
        x = x.reshape(*x.shape[:first], size, *x.shape[last + 1 :])
        x = lax.squeeze(_reduced(x, first, operator), [first])
    return x


def _runs(axes: Sequence[int]) -> list[tuple[int, int]]:
    """First and last of the axes that follow each other."""
    runs = itertools.groupby(enumerate(sorted(axes)), lambda place: place[1] - place[0])
    runs = [[axis for _, axis in run] for _, run in runs]
    return [(run[0], run[-1]) for run in runs]


def _reduced(x, axis: int, operator):
    """Reduction of an axis, kept with size one: eight parts of the axis at a time."""
    size = x.shape[axis]
    if size == 1:
        return x
    parts = min(size, SUM_PARTS)
    length = size // parts
    edges = [*range(0, (parts + 1) * length, length), *range(parts * length + 1, size + 1)]
    slices = [lax.slice_in_dim(x, a, b, axis=axis) for a, b in itertools.pairwise(edges)]
    total = _reduced(functools.reduce(operator, slices[:parts]), axis, operator)
    return functools.reduce(operator, slices[parts:], total)


def select_n(lanes, eqn, values, flags):
    """Cases are of full shape; the selector is, too, or one scalar for all lanes."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    which, *cases = values
    if flags[0] or jnp.ndim(which):
        which = fill(which, flags[0], shape)
    return bind(eqn, which, *(fill(v, f, shape) for v, f in zip(cases, flags[1:], strict=True)))


def clamp(lanes, eqn, values, flags):
    """Bounds are scalars for all lanes, or of full shape."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    low, x, high = values
    if flags[0] or flags[2] or jnp.ndim(low) or jnp.ndim(high):
        low, high = fill(low, flags[0], shape), fill(high, flags[2], shape)
    return bind(eqn, low, fill(x, flags[1], shape), high)


def wave(stand_in, lanes, eqn, values, flags):
    """Sine or cosine; of float32 numbers by what stands in for it."""
    if values[0].dtype != jnp.float32 or eqn.params.get("accuracy") is not None:
        return elementwise(lanes, eqn, values, flags)
    return [stand_in(values[0])]


def same_axes(lanes, eqn, values, flags):
    """Primitives whose parameters name axes from the front: reductions, sorts, scans."""
    return bind(eqn, *_all(lanes, values, flags))


def computed_first(lanes, eqn, values, flags):
    """A barrier that also works on a CPU."""
    return [computed(v) for v in _all(lanes, values, flags)]


def one_answer(lanes, eqn, values, flags):
    """All lanes decide together: the result has no lanes though an operand does."""
    return [anywhere(jnp.any(values[0], -1))]


def here_are_lanes(lanes, eqn, values, flags):
    """The other result without lanes: there are some."""
    return [jnp.ones((), bool)]


def bitcast(lanes, eqn, values, flags):
    """Elementwise between types of one width; between others a minor axis comes or goes."""
    if eqn.invars[0].aval.ndim != eqn.outvars[0].aval.ndim:
        return None
    return bind(eqn, *values)


def broadcast_in_dim(lanes, eqn, values, flags):
    """Appends the lane axis to the result and maps the operand's onto it."""
    p = eqn.params
    shape, axes = tuple(p["shape"]), tuple(p["broadcast_dimensions"])
    if params.is_divided(p.get("sharding")) or len(values) > 1:
        return None
    return [lax.broadcast_in_dim(values[0], (*shape, lanes.size), (*axes, len(shape)))]


def reshape(lanes, eqn, values, flags):
    """The lane axis is not touched."""
    p = eqn.params
    if params.is_divided(p.get("sharding")) or p.get("dimensions") is not None or len(values) > 1:
        return None
    return [lax.reshape(values[0], (*p["new_sizes"], lanes.size))]


def transpose(lanes, eqn, values, flags):
    """The lane axis stays last."""
    order = tuple(eqn.params["permutation"])
    return [Transposed(values[0], (*order, len(order)))]


def slice_(lanes, eqn, values, flags):
    """Every lane is kept."""
    p = eqn.params
    strides = p["strides"] and (*p["strides"], 1)
    start, limit = (*p["start_indices"], 0), (*p["limit_indices"], lanes.size)
    return [lax.slice(values[0], start, limit, strides)]


def pad(lanes, eqn, values, flags):
    """Zeros are added when it is known to what; with a value for each lane, select it."""
    x = lanes.materialise(values[0], flags[0])
    config = (*eqn.params["padding_config"], (0, 0, 0))
    if _is_zero(eqn.invars[1]) and all(p >= 0 and q >= 0 and r == 0 for p, q, r in config):
        shape = (*eqn.outvars[0].aval.shape, lanes.size)
        return [Pieces(shape, ((tuple(p for p, _, _ in config), x),))]
    if not flags[1]:
        return [lax.pad(x, values[1], config)]
    inside = lax.pad(jnp.ones(x.shape, bool), False, config)
    x = lax.pad(x, jnp.zeros((), x.dtype), config)
    return [lax.select(inside, x, fill(values[1], True, x.shape))]


def _is_zero(atom) -> bool:
    return isinstance(atom, jex.Literal) and np.ndim(atom.val) == 0 and atom.val == 0


def bind(eqn, *values) -> list:
    """The primitive itself, parameters unchanged."""
    results = eqn.primitive.bind(*values, **eqn.params)
    return list(results) if eqn.primitive.multiple_results else [results]


def _all(lanes, values, flags) -> list:
    return [lanes.materialise(v, f) for v, f in zip(values, flags, strict=True)]


ELEMENTWISE = """
abs acos acosh add and asin asinh atan atan2 atanh bessel_i0e bessel_i1e cbrt ceil clz
complex conj convert_element_type copy copy_p cosh digamma div eq eq_to erf erf_inv erfc exp
exp2 expm1 floor ge gt igamma igamma_grad_a igammac imag integer_pow is_finite le le_to lgamma log
log1p log2 logistic lt lt_to max min mul mulhi name ne neg nextafter not one_minus_square or
polygamma population_count pow real reduce_precision regularized_incomplete_beta rem round rsqrt
shift_left shift_right_arithmetic shift_right_logical sign sinh sqrt square
stop_gradient sub tan tanh xor zeta
""".split()

SAME_AXES = """
argmax argmin concatenate cumlogsumexp cummax cummin cumprod cumsum expand_dims
reduce_prod reduce_xor
rev sort split squeeze unstack
""".split()

RULES: dict[str, Callable] = {
    **dict.fromkeys(ELEMENTWISE, elementwise),
    **dict.fromkeys(SAME_AXES, same_axes),
    "add_any": add_any,
    "anywhere": one_answer,
    "bitcast_convert_type": bitcast,
    "broadcast_in_dim": broadcast_in_dim,
    "clamp": clamp,
    "pad": pad,
    "reshape": reshape,
    "in_lanes": here_are_lanes,
    "optimization_barrier": computed_first,
    "reduce_and": functools.partial(reduction, functools.partial(_combined, lax.bitwise_and)),
    "reduce_max": functools.partial(extremum, lax.max),
    "reduce_min": functools.partial(extremum, lax.min),
    "reduce_or": functools.partial(reduction, functools.partial(_combined, lax.bitwise_or)),
    "reduce_sum": reduce_sum,
    "select_n": select_n,
    "stack": stack,
    "sin": functools.partial(wave, trigonometry.sin),
    "cos": functools.partial(wave, trigonometry.cos),
    "slice": slice_,
    "transpose": transpose,
    "dot_general": contract.dot_general,
    "lane_contract": contract.nested,
    **dict.fromkeys(lapack.AXES, lapack.one_by_one),
    "cholesky": linalg.cholesky,
    "lu": linalg.lu,
    "triangular_solve": linalg.triangular_solve,
    "gather": index.gather,
    "dynamic_slice": index.dynamic_slice,
    "dynamic_update_slice": index.dynamic_update_slice,
    **dict.fromkeys(
        ("scatter", "scatter-add", "scatter_add", "scatter-mul", "scatter_mul", "scatter-min",
         "scatter_min", "scatter-max", "scatter_max", "scatter-sub", "scatter_sub"),
        index.scatter,
    ),
}  # fmt: skip
