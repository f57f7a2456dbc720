"""Decisions that are the same for all elements of a batch.

If the predicate of a `cond` depends on the element of a batch, both branches are computed for all
elements. A rare and expensive branch should rather be taken by all elements if one needs it, and
else by none.
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
in_cpu_kernel_p = jex.Primitive("in_cpu_kernel")


def any_in_batch(x: Bool[Array, "*n"]) -> Bool[Array, "*n"]:
    """Return x; in a batch, whether x is true for any element of the batch.

    Use it only for decisions that affect how a result is computed, not its value.
    """
    return any_in_batch_p.bind(x)


def is_batched(x: Array) -> Bool[Array, ""]:
    """Whether `jaxsim.vmap` maps over x; False outside of it.

    The result is a constant for the compiler, so that a branch that pays only for a batch is not
    compiled otherwise.
    """
    return is_batched_p.bind(lax.stop_gradient(x))  # JAX then asks for no derivative


def in_cpu_kernel(x: Array) -> Bool[Array, ""]:
    """Whether x is computed in a kernel for a CPU, of `jaxsim.lanes`; a constant as `is_batched`.

    There a branch is taken by each group of lanes for itself, and costs little to compile.
    """
    return in_cpu_kernel_p.bind(lax.stop_gradient(x))


def serial_or_parallel(serial: Callable, parallel: Callable, *operands: Any) -> Any:
    """Evaluate `serial` on a CPU, `parallel` on other platforms; both compute the same result.

    On a CPU, a loop over the elements that are needed is cheaper than computing all elements, which
    a parallel processor computes at the same time.

    Args:
      serial: function of the operands for a CPU.
      parallel: function of the operands for other platforms.
      operands: arguments of both.
    """
    return lax.platform_dependent(*operands, cpu=serial, default=parallel)


def nonzero_in_batch(W: Float[Array, "n ..."]) -> Bool[Array, "n"]:
    """(n,) whether each item has a nonzero weight in some element of the batch."""
    return any_in_batch(jnp.any(W != 0, axis=tuple(range(1, W.ndim))))


def index_of_nth(rank: Int[Array, "n"], i: Int[Array, ""]) -> Int[Array, ""]:
    """Index of the i-th true item, with i from zero; n if there are not so many.

    Args:
      rank: cumulative sum of a mask.
      i: number of the item.
    """
    return jnp.sum(rank <= i)


def _any_batched(values, axes):
    return any_in_batch(jnp.any(values[0], axes[0])), None  # not mapped


def _no_lanes(x):
    return jnp.zeros((), bool)


any_in_batch_p.def_impl(lambda x: x)
any_in_batch_p.def_abstract_eval(lambda x: x)
batching.primitive_batchers[any_in_batch_p] = _any_batched
mlir.register_lowering(any_in_batch_p, lambda _, x: [x])


def _define(primitive: jex.Primitive) -> None:
    """A question about where a program runs; false unless a rule says something else."""
    primitive.def_impl(_no_lanes)
    primitive.def_abstract_eval(
        lambda x: x.update(shape=(), dtype=jnp.dtype(bool), weak_type=False)
    )
    batching.primitive_batchers[primitive] = lambda values, axes: (primitive.bind(*values), None)
    mlir.register_lowering(primitive, mlir.lower_fun(_no_lanes, multiple_results=False))


_define(is_batched_p)
_define(in_cpu_kernel_p)


def any_rule(lanes, eqn, values, flags):
    """The rule of `any_in_batch`: its result is uniform, although its operand is batched."""
    return [any_in_batch(jnp.any(values[0], -1))]


def is_batched_rule(lanes, eqn, values, flags):
    """The rule of `is_batched`: true, because its operand is batched."""
    return [jnp.ones((), bool)]


def in_cpu_kernel_rule(lanes, eqn, values, flags):
    """The rule of `in_cpu_kernel`: false, because the program is XLA's."""
    return [jnp.zeros((), bool)]


register("any_in_batch", rule=any_rule, uniform=True, in_section=True)
register("is_batched", rule=is_batched_rule, uniform=True)
register("in_cpu_kernel", rule=in_cpu_kernel_rule, uniform=True)
