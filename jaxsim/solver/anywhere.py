"""Decisions that a batch takes together.

Where a branch depends on the element of a batch, both branches are computed for all of them. A rare
and expensive one is better entered by all as soon as one needs it, and else by none.
"""

import jax.numpy as jnp
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Bool, Float, Int

anywhere_p = jex.Primitive("anywhere")


def anywhere(x: Bool[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether each x is true; in a batch, whether it is for any of its elements.

    To be used only where the answer changes how something is computed, not what.
    """
    return anywhere_p.bind(x)


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


def _batch(values, axes):
    return anywhere(jnp.any(values[0], axes[0])), None  # not mapped


def _jvp(primals, tangents):
    found = anywhere_p.bind(*primals)
    return found, ad.Zero.from_primal_value(found)


anywhere_p.def_impl(lambda x: x)
anywhere_p.def_abstract_eval(lambda x: x)
ad.primitive_jvps[anywhere_p] = _jvp
batching.primitive_batchers[anywhere_p] = _batch
mlir.register_lowering(anywhere_p, lambda _, x: [x])
