"""Reverse mode by a kernel: the pullback of a function, as one kernel that evaluates it again."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.arrays import tuning
from jaxsim.arrays.finite import zero_if_finite
from jaxsim.lanes.primitive import as_kernel


def with_pullback_kernel(f: Callable, *, finite_math: bool = False) -> Callable:
    """`as_kernel(f)`, whose derivative in reverse mode is a kernel, too.

    Between the two passes only the arguments are stored; the second kernel evaluates `f` again. It
    stands for XLA's derivative of `f`, and takes a tenth of its time. Forward mode and second
    derivatives are errors, as for every `jax.custom_vjp`.

    Args:
      f: as for `as_kernel`.
      finite_math: as for `as_kernel`; cotangents are NaN if an argument or a cotangent is.
    """

    @jax.custom_vjp
    def call(*args):
        return as_kernel(f, finite_math=finite_math)(*args)

    def forward(*args):
        return call(*args), args

    def backward(args, cotangents):
        return _pull(f, args, cotangents, finite_math)

    call.defvjp(forward, backward)
    return call


def _pull(f: Callable, args: tuple, cotangents: Any, finite_math: bool) -> tuple:
    """The cotangents of the arguments; a kernel has no place for those of integers."""
    places, structure = jax.tree.flatten(cotangents)
    given = [c for c in places if _moves(c)]

    def pullback(args, given):
        rest = iter(given)
        full = [next(rest) if _moves(c) else np.zeros(c.shape, c.dtype) for c in places]
        found = jax.vjp(f, *args)[1](structure.unflatten(full))
        found = [c for c in jax.tree.leaves(found) if _moves(c)]
        if not finite_math:
            return found
        nothing = zero_if_finite((args, given))
        return [c + nothing for c in found]

    leaves, structure_of_args = jax.tree.flatten(args)
    kernel = as_kernel(pullback, tuning.PULLBACK_SCALARS, finite_math=finite_math)
    found = iter(kernel(args, given))
    return structure_of_args.unflatten(
        [next(found) if _smooth(x) else np.zeros(x.shape, jax.dtypes.float0) for x in leaves]
    )


def _moves(cotangent: Any) -> bool:
    return cotangent.dtype != jax.dtypes.float0


def _smooth(x: Any) -> bool:
    return jnp.issubdtype(jnp.result_type(x), jnp.inexact)
