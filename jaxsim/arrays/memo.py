"""Memoisation by identity: results are kept for as long as the object they come from."""

import functools
import weakref
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

_CONSTANT = (jax.Array, int, float, complex, np.generic)


def once_for_each(f: Callable) -> Callable:
    """Return `f(tree, *rest)` memoised by the identity of `tree`, until `tree` is deleted.

    The numbers in a tree are not compared. If a leaf is mutable, such as a NumPy array, or anything
    is traced, nothing is stored and `f` is called each time.

    Args:
      f: a function of an instance of a frozen class and of hashable arguments. Its result must not
        refer to that instance, which would then never be deleted.
    """
    results: dict[tuple, Any] = {}

    @functools.wraps(f)
    def memoised(tree, *rest):
        key = id(tree), *rest
        if key in results:
            return results[key]
        result = f(tree, *rest)
        # Inside a traced function, results computed from constants may be tracers, too.
        if _is_constant(tree) and not is_traced((tree, result)):
            results[key] = result
            weakref.finalize(tree, results.pop, key, None).atexit = False
        return result

    return memoised


def _is_constant(tree: Any) -> bool:
    return all(isinstance(leaf, _CONSTANT) for leaf in jax.tree.leaves(tree))


def is_traced(tree: Any) -> bool:
    """Whether any leaf is a tracer, that is an argument of a function that JAX is transforming."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))
