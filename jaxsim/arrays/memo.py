"""Results that are kept for as long as what they were computed from."""

import functools
import weakref
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

_CONSTANT = (jax.Array, int, float, complex, np.generic)


def once_for_each(f: Callable) -> Callable:
    """`f(tree, *rest)`, computed once for each tree and kept for as long as the tree lives.

    Trees are told apart by identity, without looking at their numbers. Where leaves may change, as
    NumPy's arrays may, or anything is traced, the result is computed anew each time.

    Args:
      f: a function of an instance of a frozen class and of hashable arguments. Its result must not
        refer to that instance, which would then live for ever.
    """
    results: dict[tuple, Any] = {}

    @functools.wraps(f)
    def remembered(tree, *rest):
        key = id(tree), *rest
        if key in results:
            return results[key]
        result = f(tree, *rest)
        # While a function is traced, what is computed of constants may be traced, too.
        if _is_constant(tree) and not is_traced((tree, result)):
            results[key] = result
            weakref.finalize(tree, results.pop, key, None).atexit = False
        return result

    return remembered


def _is_constant(tree: Any) -> bool:
    return all(isinstance(leaf, _CONSTANT) for leaf in jax.tree.leaves(tree))


def is_traced(tree: Any) -> bool:
    """Whether any leaf belongs to a function that JAX is transforming."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))
