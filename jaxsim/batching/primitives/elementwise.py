"""Primitives with operands of one shape and a result of the same."""

import itertools

import jax.numpy as jnp

from jaxsim.batching.padded_sum import PaddedSum
from jaxsim.batching.primitives.operands import bind, broadcast_full, broadcast_unless_scalar
from jaxsim.batching.registry import register


def elementwise(lanes, eqn, values, flags):
    """Same shapes in, the same shape out."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    values = [broadcast_unless_scalar(v, f, shape) for v, f in zip(values, flags, strict=True)]
    return bind(eqn, *values)


def add_any(lanes, eqn, values, flags):
    """The sum of cotangents takes no scalars for arrays, but arrays that are not yet whole."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    for x, y in itertools.permutations(zip(values, flags, strict=True)):
        if isinstance(x[0], PaddedSum):
            return [x[0].plus(y[0] if isinstance(y[0], PaddedSum) else broadcast_full(*y, shape))]
    return bind(eqn, *(broadcast_full(v, f, shape) for v, f in zip(values, flags, strict=True)))


def select_n(lanes, eqn, values, flags):
    """Cases are of full shape; the selector is, too, or one scalar for all lanes."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    which, *cases = values
    if flags[0] or jnp.ndim(which):
        which = broadcast_full(which, flags[0], shape)
    return bind(
        eqn, which, *(broadcast_full(v, f, shape) for v, f in zip(cases, flags[1:], strict=True))
    )


def clamp(lanes, eqn, values, flags):
    """Bounds are scalars for all lanes, or of full shape."""
    shape = (*eqn.outvars[0].aval.shape, lanes.size)
    low, x, high = values
    if flags[0] or flags[2] or jnp.ndim(low) or jnp.ndim(high):
        low, high = broadcast_full(low, flags[0], shape), broadcast_full(high, flags[2], shape)
    return bind(eqn, low, broadcast_full(x, flags[1], shape), high)


def bitcast(lanes, eqn, values, flags):
    """Elementwise between types of one width; between others a minor axis comes or goes."""
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
