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

    Trees are told apart by identity, without looking at their numbers. With leaves that may change,
    as NumPy's arrays may, or that are traced, the result is computed anew each time.

    Args:
      f: a function of an instance of a class and of hashable arguments. Its result must not refer
        to that instance, which would then live for ever.
    """
    results: dict[tuple, Any] = {}

    @functools.wraps(f)
    def remembered(tree, *rest):
        if not all(map(_is_constant, jax.tree.leaves(tree))):
            return f(tree, *rest)
        key = id(tree), *rest
        if key not in results:
            results[key] = f(tree, *rest)
            weakref.finalize(tree, results.pop, key, None).atexit = False
        return results[key]

    return remembered


def _is_constant(leaf: Any) -> bool:
    return isinstance(leaf, _CONSTANT) and not isinstance(leaf, jax.core.Tracer)
