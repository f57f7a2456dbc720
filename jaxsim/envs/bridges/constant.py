"""An environment as a constant of programs.

A program with the numbers of a model as constants is faster than one with a model as argument,
because facts about the model are known while it is traced. Environments with equal numbers share
their programs.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxsim.envs.base.env import Env

KEPT = 64  # programs of each kind


class Constant:
    """An environment that equals others of the same structure and the same numbers.

    Attributes:
      env: the environment, whose leaves are arrays and numbers.
    """

    def __init__(self, env: Env):
        self.env = env
        leaves, structure = jax.tree.flatten(env)
        self._key = structure, tuple(map(_bytes, leaves))
        self._hash = hash(self._key)

    def __hash__(self) -> int:
        """A hash that is the same for equal numbers."""
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are equal, bit by bit."""
        return isinstance(other, Constant) and self._key == other._key


def programs_of(build: Callable) -> Callable:
    """Memoise a function `(constant, ...)` that compiles a program."""
    return functools.lru_cache(maxsize=KEPT)(build)


def _bytes(leaf: Any) -> tuple[type, str, tuple[int, ...], bytes]:
    array = np.asarray(leaf)
    return type(leaf), array.dtype.name, array.shape, array.tobytes()
