"""A state as one vector of 32-bit words.

Each array that a compiled program takes or returns costs several microseconds, and a state has
about twenty. As a single array they cost little, which one environment alone notices.
"""

import dataclasses
import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, UInt32


@dataclasses.dataclass(frozen=True)
class Place:
    """Where an array lies in a vector of words.

    Attributes:
      start: its first word.
      count: how many words it has.
      shape: of the array.
      dtype: of the array.
    """

    start: int
    count: int
    shape: tuple[int, ...]
    dtype: Any

    def read(self, words: np.ndarray) -> np.ndarray:
        """A copy of the array, from words on the host; of a batch from (..., words)."""
        part = np.ascontiguousarray(words[..., self.start : self.start + self.count])
        whole = part.view(_wide(self.dtype)).reshape((*words.shape[:-1], *self.shape))
        return whole.astype(self.dtype)


@dataclasses.dataclass(frozen=True)
class Words:
    """Where the arrays of a pytree lie in the vector of its words.

    Attributes:
      structure: of the tree.
      leaves: shape and type of each array.
    """

    structure: Any
    leaves: tuple[jax.ShapeDtypeStruct, ...]

    @classmethod
    def of(cls, tree: Any) -> "Words":
        """The layout of a tree of arrays, which may be traced."""
        leaves, structure = jax.tree.flatten(jax.eval_shape(lambda: tree))
        return cls(structure, tuple(leaves))

    @functools.cached_property
    def places(self) -> Any:
        """The tree, with a `Place` for each array."""
        found, start = [], 0
        for like in self.leaves:
            count = math.prod(_shape(like))
            found.append(Place(start, count, like.shape, like.dtype))
            start += count
        return self.structure.unflatten(found)

    def packed(self, tree: Any) -> UInt32[Array, "words"]:
        """The words of a tree of this structure."""
        leaves = self.structure.flatten_up_to(tree)
        pairs = zip(leaves, self.leaves, strict=True)
        return jnp.concatenate([_to_words(x, like.dtype).reshape(-1) for x, like in pairs])

    def read(self, words: np.ndarray) -> Any:
        """The tree of NumPy's arrays of these words, or of a batch of them, (..., words)."""
        return jax.tree.map(lambda place: place.read(words), self.places)

    def unpacked(self, words: UInt32[Array, "words"]) -> Any:
        """The tree of these words."""
        found = []
        for like, place in zip(self.leaves, jax.tree.leaves(self.places), strict=True):
            part = words[place.start : place.start + place.count].reshape(_shape(like))
            found.append(_from_words(part, like.dtype))
        return self.structure.unflatten(found)


def _shape(like: jax.ShapeDtypeStruct) -> tuple[int, ...]:
    """The shape of an array's words."""
    return jax.eval_shape(lambda x: _to_words(x, like.dtype), like).shape


def _to_words(x: Any, dtype: Any) -> Array:
    """An array of this type as words; a number of eight bytes has an axis of two of them."""
    if jnp.issubdtype(dtype, jax.dtypes.prng_key):
        return jax.random.key_data(x)
    return lax.bitcast_convert_type(jnp.asarray(x, dtype).astype(_wide(dtype)), jnp.uint32)


def _from_words(words: Array, dtype: Any) -> Array:
    if jnp.issubdtype(dtype, jax.dtypes.prng_key):
        return jax.random.wrap_key_data(words)
    return lax.bitcast_convert_type(words, _wide(dtype)).astype(dtype)


def _wide(dtype: Any) -> np.dtype:
    """The type itself, or one of four bytes that contains it."""
    if dtype.itemsize >= 4:
        return dtype
    return np.dtype(np.float32 if jnp.issubdtype(dtype, jnp.floating) else np.int32)
