"""Vectorised sine and cosine of float32 numbers.

On a CPU, XLA calls the C library for each sine: 17 ns each, an eighth of the humanoid's step. A
vectorised polynomial takes 1 ns (one core with AVX-512).
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from jaxsim.arrays.series import horner
from jaxsim.batching.primitives.elementwise import elementwise
from jaxsim.batching.primitives.jvp_rule import with_jvp_rule
from jaxsim.batching.registry import register

# pi/2 in three parts (Cody and Waite, "Software Manual for the Elementary Functions", 1980): the
# first two have eight bits each, so that their products with whole numbers below 2^16 are exact.
_QUARTER_TURN = 1.5703125, 0.000484466552734375, -6.3975784e-07
# Minimax polynomials in r^2 for |r| <= pi/4, by Remez' algorithm: (sin r - r) / r^3 with a relative
# error of sin r of 4e-9, (cos r - 1 + r^2 / 2) / r^4 with an error of cos r of 1e-10.
_SINE = -0.16666655, 0.008332178, -0.00019517235
_COSINE = 0.041666646, -0.0013887367, 2.443838e-05


def sin(x: jax.Array) -> jax.Array:
    """Sine of float32 numbers, with an error of at most 1e-7 for |x| < 1e5.

    For larger arguments the error is up to their rounding error. If x is not finite, it is NaN.
    """
    return _wave_with_slope(0, lax.sin, lambda x, t: t * cos(x))(x)[0]


def cos(x: jax.Array) -> jax.Array:
    """Cosine of float32 numbers, as accurate as `sin`."""
    return _wave_with_slope(1, lax.cos, lambda x, t: -t * sin(x))(x)[0]


def _wave_with_slope(shift: int, library: Callable, slope: Callable) -> Callable:
    """The polynomial on a CPU, `library` on other platforms, and their derivative."""

    def f(x):
        return [lax.platform_dependent(x, cpu=functools.partial(_wave, shift), default=library)]

    def rule(primals, tangents):
        return with_jvp_rule(f, rule)(*primals), [slope(*primals, *tangents)]

    return with_jvp_rule(f, rule)


def _wave(shift: int, x: jax.Array) -> jax.Array:
    """The sine of `x + shift pi / 2`."""
    turns = lax.round(x * (1 / sum(_QUARTER_TURN)), lax.RoundingMethod.TO_NEAREST_EVEN)
    r = x
    for part in _QUARTER_TURN:
        r = r - turns * part
    one = r.dtype.type(1)
    r = lax.clamp(-one, r, one)  # beyond where the products are exact
    quadrant = turns + shift
    quadrant = quadrant - 4 * lax.floor(0.25 * quadrant)
    square = r * r
    sine = r + r * square * horner(_SINE, square)
    cosine = 1 - 0.5 * square + square * square * horner(_COSINE, square)
    size = jnp.where((quadrant == 1) | (quadrant == 3), cosine, sine)
    return jnp.where(quadrant >= 2, -size, size)


def wave(stand_in, lanes, eqn, values, flags):
    """Sine or cosine; for float32 numbers by the function `stand_in`."""
    if values[0].dtype != jnp.float32 or eqn.params.get("accuracy") is not None:
        return elementwise(lanes, eqn, values, flags)
    return [stand_in(values[0])]


register("sin", rule=functools.partial(wave, sin), in_section=True)
register("cos", rule=functools.partial(wave, cos), in_section=True)
