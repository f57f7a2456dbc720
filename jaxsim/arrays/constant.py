"""A tree of arrays as a constant of programs, which trees of equal numbers share."""

from typing import Any

import jax
import numpy as np


class Constant:
    """A tree that equals others of the same structure and the same numbers; it can be hashed.

    Attributes:
      value: the tree, whose leaves are arrays and numbers that are not traced.
      structure: its structure.
    """

    def __init__(self, value: Any):
        leaves, self.structure = jax.tree.flatten(value)
        self.value = value
        self._key = self.structure, tuple(map(_bytes, leaves))
        self._hash = hash(self._key)

    def __hash__(self) -> int:
        """A hash that is the same for equal numbers."""
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are equal, bit by bit."""
        return isinstance(other, Constant) and self._key == other._key


def _bytes(leaf: Any) -> tuple[type, str, tuple[int, ...], bytes]:
    array = np.asarray(leaf)
    return type(leaf), array.dtype.name, array.shape, array.tobytes()
