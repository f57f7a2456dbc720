"""Elementwise primitives: operands and result have the same shape."""

import itertools

import jax.numpy as jnp

from jaxsim.batching.padded_sum import PaddedSum
from jaxsim.batching.primitives.operands import bind, broadcast_full, broadcast_unless_scalar
from jaxsim.batching.registry import register


def elementwise(lanes, eqn, values, flags):
    """An elementwise primitive, with all operands broadcast to the shape with lanes."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    values = [broadcast_unless_scalar(v, f, shape) for v, f in zip(values, flags, strict=True)]
    return bind(eqn, *values)


def add_any(lanes, eqn, values, flags):
    """A sum of cotangents: operands are never scalars for arrays, but may be a `PaddedSum`."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    for x, y in itertools.permutations(zip(values, flags, strict=True)):
        if isinstance(x[0], PaddedSum):
            return [x[0].plus(y[0] if isinstance(y[0], PaddedSum) else broadcast_full(*y, shape))]
    return bind(eqn, *(broadcast_full(v, f, shape) for v, f in zip(values, flags, strict=True)))


def select_n(lanes, eqn, values, flags):
    """A `select_n`: cases have the full shape; the selector has it, too, or is one scalar."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    which, *cases = values
    if flags[0] or jnp.ndim(which):
        which = broadcast_full(which, flags[0], shape)
    return bind(
        eqn, which, *(broadcast_full(v, f, shape) for v, f in zip(cases, flags[1:], strict=True))
    )


def clamp(lanes, eqn, values, flags):
    """A `clamp`: bounds are scalars for all lanes, or have the full shape."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    low, x, high = values
    if flags[0] or flags[2] or jnp.ndim(low) or jnp.ndim(high):
        low, high = broadcast_full(low, flags[0], shape), broadcast_full(high, flags[2], shape)
    return bind(eqn, low, broadcast_full(x, flags[1], shape), high)


def bitcast(lanes, eqn, values, flags):
    """A bitcast: elementwise for types of equal width, else it adds or removes the last axis."""
    if eqn.invars[0].aval.ndim != eqn.outvars[0].aval.ndim:
        return None
    return bind(eqn, *values)


register(
    *"""
    abs acos acosh add and asin asinh atan atan2 atanh cbrt ceil convert_element_type copy copy_p
    cosh div eq erf exp exp2 expm1 floor ge gt integer_pow is_finite le log log1p logistic lt max
    min mul name ne neg nextafter not or population_count pow real rem round rsqrt shift_left
    shift_right_arithmetic shift_right_logical sign sinh sqrt square stop_gradient sub tan tanh xor
    """.split(),
    rule=elementwise,
    in_section=True,
)
register(
    *"""
    bessel_i0e bessel_i1e clz complex conj digamma eq_to erf_inv erfc igamma igamma_grad_a igammac
    imag le_to lgamma log2 lt_to mulhi one_minus_square polygamma reduce_precision
    regularized_incomplete_beta zeta
    """.split(),
    rule=elementwise,
)
register("add_any", rule=add_any, in_section=True, takes=(PaddedSum,))
register("bitcast_convert_type", rule=bitcast, in_section=True)
register("clamp", rule=clamp, in_section=True)
register("select_n", rule=select_n, in_section=True)
