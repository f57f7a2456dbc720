"""Functions that kernels for CPUs compute in another way."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

from jaxsim.batching.primitives.jvp_rule import moving_leaves, with_jvp_rule
from jaxsim.lanes.switch import tracing_cpu_kernel

T = TypeVar("T")


def kernel_alternative(f: Callable[..., T], otherwise: Callable[..., T]) -> Callable[..., T]:
    """`f` in kernels for CPUs; elsewhere and for derivatives `otherwise`, of the same results.

    So `f` may have loops whose length is known at run time, which reverse mode cannot go through.

    Args:
      f: function of pytrees of arrays; it must not close over traced values.
      otherwise: function of the same arguments.
    """

    def call(*args):
        if not tracing_cpu_kernel():
            return otherwise(*args)
        leaves, structure = jax.tree.flatten(args)
        shape = jax.eval_shape(f, *args)

        def flat(g: Callable[..., T]) -> Callable[..., list]:
            return lambda *xs: jax.tree.leaves(g(*structure.unflatten(xs)))

        def rule(primals, tangents):
            moved, given, with_leaves = moving_leaves(list(primals), tangents)
            along = lambda *xs: flat(otherwise)(*with_leaves(*xs))  # noqa: E731
            results, dots = jax.jvp(along, moved, given)
            return results, [d if _smooth(x) else None for x, d in zip(results, dots, strict=True)]

        found = with_jvp_rule(flat(f), rule)(*leaves)
        return jax.tree.unflatten(jax.tree.structure(shape), found)

    return call


def _smooth(x: jax.Array) -> bool:
    return jnp.issubdtype(x.dtype, jnp.inexact)
