"""Functions that compile themselves where they are called outside of JAX's transformations."""

import functools
from collections.abc import Callable
from typing import Any

import jax

from jaxsim.arrays.memo import is_traced


def as_a_whole(f: Callable) -> Callable:
    """The same function, compiled as a whole where none of its arguments is traced.

    Its operations one by one take several times as long, and its loops and branches would be
    compiled anew at every call. The program is kept, as `jax.jit` keeps it.

    Args:
      f: a function of pytrees of arrays.
    """
    compiled = jax.jit(f)

    @functools.wraps(f)
    def call(*args: Any) -> Any:
        return f(*args) if is_traced(args) else compiled(*args)

    return call
