"""Selection of the candidates that are within reach, in a fixed number of slots.

There may be thousands of candidates of which few are close, so nothing is sorted. Each candidate
within reach sets a bit. The j-th set bit is found by descending a tree of counts, first to a word
and then to halves of it (rank and select: Jacobson, "Space-efficient static trees and graphs",
1989). All of this is vector arithmetic.
"""

from collections.abc import Callable
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int, UInt32

T = TypeVar("T")
WORD = 32


def within_reach(
    excess: Float[Array, "n"], count: int
) -> tuple[Int[Array, "{count}"], Int[Array, ""]]:
    """Candidates with negative excess, the `count` lowest if there are more.

    Args:
      excess: distance minus reach of each candidate. NaN counts as negative, so that it is not
        lost.
      count: number of slots, less than n.

    Returns:
      Indices of the candidates in increasing order; slots that are left over have the index of a
      candidate out of reach. And the number of candidates within reach that are not included.
    """
    reached = ~(excess >= 0)
    chosen = _lowest(excess, reached, count)
    return set_indices(chosen, count), jnp.sum(reached) - jnp.minimum(jnp.sum(chosen), count)


def set_indices(mask: Bool[Array, "n"], count: int) -> Int[Array, "{count}"]:
    """The first `count` indices where the mask is set, then an index where it is not."""
    words = _words(mask)
    levels = [lax.population_count(words).astype(jnp.int32)]
    while len(levels[-1]) > 1:
        pairs = jnp.pad(levels[-1], (0, len(levels[-1]) % 2)).reshape(-1, 2)
        levels.append(jnp.sum(pairs, axis=1))
    rank = lax.iota(jnp.int32, count)
    exists = rank < levels[-1]
    index = jnp.zeros_like(rank)
    for level in reversed(levels[:-1]):
        rank, index = _descend(rank, 2 * index, jnp.take(level, 2 * index, mode="clip"), 1)
    word, index = jnp.take(words, index, mode="clip"), WORD * index
    for width in (16, 8, 4, 2, 1):
        half = (word >> (index % WORD).astype(word.dtype)) & np.uint32((1 << width) - 1)
        below = lax.population_count(half).astype(rank.dtype)
        rank, index = _descend(rank, index, below, width)
    unset = jnp.max(jnp.where(mask, 0, lax.iota(index.dtype, len(mask))))
    # XLA would otherwise recompute the descent for each use.
    return lax.optimization_barrier(jnp.where(exists, index, unset))


def for_each_set(mask: Bool[Array, "n"], body: Callable[[Int[Array, ""], T], T], init: T) -> T:
    """`body(index, value)` for each index where a short mask is set, in increasing order.

    In a batch each element goes through its own indices, so that the loop is as long as the longest
    list, not as the mask.

    Args:
      mask: the mask, of at most `WORD` bits.
      body: function from an index and a value to the next value.
      init: the first value.
    """
    (word,) = _words(mask)

    def turn(state):
        word, value = state
        index = lax.population_count(~word & (word - 1)).astype(jnp.int32)
        # Elements that have ended go on with the last index, to no effect.
        return word & (word - 1), body(jnp.minimum(index, len(mask) - 1), value)

    return lax.while_loop(lambda state: state[0] != 0, turn, (word, init))[1]


def _descend(rank, index, count, step: int):
    """Descend to the part at `index`, with `count` set bits, or to the next one, `step` later."""
    beyond = rank >= count
    return jnp.where(beyond, rank - count, rank), jnp.where(beyond, index + step, index)


def _words(mask: Bool[Array, "n"]) -> UInt32[Array, "w"]:
    """The mask packed into words, one bit for each element."""
    bits = jnp.pad(mask, (0, -len(mask) % WORD)).reshape(-1, WORD).astype(jnp.uint32)
    return jnp.sum(bits << np.arange(WORD, dtype=np.uint32)[None], axis=1, dtype=jnp.uint32)


def _lowest(excess: Float[Array, "n"], reached: Bool[Array, "n"], count: int) -> Bool[Array, "n"]:
    """Mask of the candidates within reach, or of the `count` lowest; the first among equals."""
    zero = jnp.zeros_like(excess[0])
    order = lax.iota(excess.dtype, len(excess))
    fits = lambda mask: jnp.sum(mask) <= count  # noqa: E731
    below = lambda limit: ~(excess >= limit)  # noqa: E731
    crowded = ~fits(reached)
    lowest = jnp.min(jnp.where(excess < 0, excess, zero))
    low, high = _bisected(lambda limit: fits(below(limit)), lowest, zero, crowded)
    first = lambda number: below(low) | below(high) & (order < number)  # noqa: E731
    number, _ = _bisected(lambda number: fits(first(number)), zero, zero + len(excess), crowded)
    return jnp.where(crowded, first(number), reached)


def _bisected(holds, low, high, wanted):
    """Bisect to adjacent numbers `low` and `high` such that `holds(low)` and not `holds(high)`.

    Only where `wanted`; elsewhere the interval is returned as it is.
    """

    def narrow(bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        holds_there = holds(middle)
        return jnp.where(holds_there, middle, low), jnp.where(holds_there, high, middle)

    def wide(bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        return wanted & (low < middle) & (middle < high)

    return lax.while_loop(wide, narrow, (low, high))
