"""A state as one vector of 32-bit words.

Each array that a compiled program takes or returns costs several microseconds, and a state has
about twenty. As a single array they cost little, which one environment alone notices.
"""

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, UInt32


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

    def packed(self, tree: Any) -> UInt32[Array, "words"]:
        """The words of a tree of this structure."""
        leaves = self.structure.flatten_up_to(tree)
        pairs = zip(leaves, self.leaves, strict=True)
        return jnp.concatenate([_to_words(x, like.dtype).reshape(-1) for x, like in pairs])

    def unpacked(self, words: UInt32[Array, "words"]) -> Any:
        """The tree of these words."""
        found, start = [], 0
        for like in self.leaves:
            shape = jax.eval_shape(lambda x, dtype=like.dtype: _to_words(x, dtype), like).shape
            size = math.prod(shape)
            found.append(_from_words(words[start : start + size].reshape(shape), like.dtype))
            start += size
        return self.structure.unflatten(found)


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
