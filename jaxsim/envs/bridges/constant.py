"""An environment as a constant of programs.

A program with the numbers of a model as constants is faster than one with a model as argument,
because facts about the model are known while it is traced. Environments with equal numbers share
their programs.
"""

import functools
from collections.abc import Callable

from jaxsim.arrays.constant import Constant

__all__ = ["KEPT", "Constant", "programs_of"]

KEPT = 64  # programs of each kind


def programs_of(build: Callable) -> Callable:
    """Memoise a function `(constant, ...)` that compiles a program."""
    return functools.lru_cache(maxsize=KEPT)(build)
