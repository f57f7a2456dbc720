"""Decisions that a batch takes together.

Where a branch depends on the element of a batch, both branches are computed for all of them. A rare
and expensive one is better entered by all as soon as one needs it, and else by none.
"""

import jax.numpy as jnp
from jax import lax
from jax.extend import core as jex
from jax.interpreters import batching, mlir
from jaxtyping import Array, Bool, Float, Int

anywhere_p = jex.Primitive("anywhere")
in_lanes_p = jex.Primitive("in_lanes")


def anywhere(x: Bool[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether each x is true; in a batch, whether it is for any of its elements.

    To be used only where the answer changes how something is computed, not what.
    """
    return anywhere_p.bind(x)


def in_lanes(x: Array) -> Bool[Array, ""]:
    """Whether this is computed for a batch of `jaxsim.vmap` in which x differs; False elsewhere.

    It is known to the compiler. So a second program for what is frequent is only compiled where
    there are lanes enough to repay it.
    """
    return in_lanes_p.bind(lax.stop_gradient(x))  # JAX then asks for no derivative


def pushing(W: Float[Array, "n ..."]) -> Bool[Array, "n"]:
    """Which of n rows or contacts have a weight that is not zero, anywhere in a batch."""
    return anywhere(jnp.any(W != 0, axis=tuple(range(1, W.ndim))))


def place(rank: Int[Array, "n"], i: Int[Array, ""]) -> Int[Array, ""]:
    """Where the i-th that is true stands, counted from zero; n if there are not so many.

    Args:
      rank: the cumulative sum of what is true.
      i: which of them.
    """
    return jnp.sum(rank <= i)


def _anywhere_batched(values, axes):
    return anywhere(jnp.any(values[0], axes[0])), None  # not mapped


def _in_lanes_batched(values, axes):
    return in_lanes(values[0]), None


def _no_lanes(x):
    return jnp.zeros((), bool)


anywhere_p.def_impl(lambda x: x)
anywhere_p.def_abstract_eval(lambda x: x)
batching.primitive_batchers[anywhere_p] = _anywhere_batched
mlir.register_lowering(anywhere_p, lambda _, x: [x])

in_lanes_p.def_impl(_no_lanes)
in_lanes_p.def_abstract_eval(lambda x: x.update(shape=(), dtype=jnp.dtype(bool), weak_type=False))
batching.primitive_batchers[in_lanes_p] = _in_lanes_batched
mlir.register_lowering(in_lanes_p, mlir.lower_fun(_no_lanes, multiple_results=False))
