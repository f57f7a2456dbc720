"""Decisions that a batch takes together.

Where a branch depends on the element of a batch, both branches are computed for all of them. A rare
and expensive one is better entered by all as soon as one needs it, and else by none.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.extend import core as jex
from jax.interpreters import batching, mlir
from jaxtyping import Array, Bool, Float, Int

from jaxsim.batching.registry import register

any_in_batch_p = jex.Primitive("any_in_batch")
is_batched_p = jex.Primitive("is_batched")


def any_in_batch(x: Bool[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether each x is true; in a batch, whether it is for any of its elements.

    To be used only where the answer changes how something is computed, not what.
    """
    return any_in_batch_p.bind(x)


def is_batched(x: Array) -> Bool[Array, ""]:
    """Whether this is computed for a batch of `jaxsim.vmap` in which x differs; False elsewhere.

    It is known to the compiler. So a second program for what is frequent is only compiled where
    there are lanes enough to repay it.
    """
    return is_batched_p.bind(lax.stop_gradient(x))  # JAX then asks for no derivative


def serial_or_parallel(serial: Callable, parallel: Callable, *operands: Any) -> Any:
    """Two ways to compute the same: the first where a program runs one operation after the other.

    There a loop over what is needed is cheaper than to compute all, which elsewhere happens at the
    same time.
    """
    return lax.platform_dependent(*operands, cpu=serial, default=parallel)


def nonzero_in_batch(W: Float[Array, "n ..."]) -> Bool[Array, "n"]:
    """Which of n rows or contacts have a weight that is not zero, anywhere in a batch."""
    return any_in_batch(jnp.any(W != 0, axis=tuple(range(1, W.ndim))))


def index_of_nth(rank: Int[Array, "n"], i: Int[Array, ""]) -> Int[Array, ""]:
    """Where the i-th that is true stands, counted from zero; n if there are not so many.

    Args:
      rank: the cumulative sum of what is true.
      i: which of them.
    """
    return jnp.sum(rank <= i)


def _any_batched(values, axes):
    return any_in_batch(jnp.any(values[0], axes[0])), None  # not mapped


def _is_batched_batched(values, axes):
    return is_batched(values[0]), None


def _no_lanes(x):
    return jnp.zeros((), bool)


any_in_batch_p.def_impl(lambda x: x)
any_in_batch_p.def_abstract_eval(lambda x: x)
batching.primitive_batchers[any_in_batch_p] = _any_batched
mlir.register_lowering(any_in_batch_p, lambda _, x: [x])

is_batched_p.def_impl(_no_lanes)
is_batched_p.def_abstract_eval(lambda x: x.update(shape=(), dtype=jnp.dtype(bool), weak_type=False))
batching.primitive_batchers[is_batched_p] = _is_batched_batched
mlir.register_lowering(is_batched_p, mlir.lower_fun(_no_lanes, multiple_results=False))


def any_rule(lanes, eqn, values, flags):
    """All lanes decide together: the result has no lanes though an operand does."""
    return [any_in_batch(jnp.any(values[0], -1))]


def is_batched_rule(lanes, eqn, values, flags):
    """Here is a batch, whatever the operand's numbers are."""
    return [jnp.ones((), bool)]


register("any_in_batch", rule=any_rule, uniform=True, in_section=True)
register("is_batched", rule=is_batched_rule, uniform=True)
