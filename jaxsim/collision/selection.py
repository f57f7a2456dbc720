"""Which candidates get the exact geometry and the contact slots: those within reach.

There may be thousands of candidates and few of them close, so nothing is sorted. Each candidate
within reach sets a bit, and the j-th set bit is found by walking down a tree of counts, first to a
word and then by halves of it (rank and select: Jacobson, "Space-efficient static trees and graphs",
1989). All of this is arithmetic on long vectors.
"""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int, UInt32

WORD = 32


def within_reach(
    excess: Float[Array, "n"], count: int
) -> tuple[Int[Array, "{count}"], Int[Array, ""]]:
    """Candidates of negative excess, the lowest of them where there are more than `count`.

    Args:
      excess: what a candidate's distance exceeds its reach by. A NaN counts as negative, so that
        it is not lost.
      count: the number of places, less than n.

    Returns:
      Candidates in increasing order, and in places that are left over one that is out of reach;
      and how many within reach found no place.
    """
    reached = ~(excess >= 0)
    chosen = _lowest(excess, reached, count)
    return set_places(chosen, count), jnp.sum(reached) - jnp.minimum(jnp.sum(chosen), count)


def set_places(mask: Bool[Array, "n"], count: int) -> Int[Array, "{count}"]:
    """The first `count` places where the mask is set, then a place where it is not."""
    words = _words(mask)
    levels = [lax.population_count(words).astype(jnp.int32)]
    while len(levels[-1]) > 1:
        pairs = jnp.pad(levels[-1], (0, len(levels[-1]) % 2)).reshape(-1, 2)
        levels.append(jnp.sum(pairs, axis=1))
    rank = lax.iota(jnp.int32, count)
    exists = rank < levels[-1]
    place = jnp.zeros_like(rank)
    for level in reversed(levels[:-1]):
        rank, place = _descend(rank, 2 * place, jnp.take(level, 2 * place, mode="clip"), 1)
    word, place = jnp.take(words, place, mode="clip"), WORD * place
    for width in (16, 8, 4, 2, 1):
        half = (word >> (place % WORD).astype(word.dtype)) & np.uint32((1 << width) - 1)
        below = lax.population_count(half).astype(rank.dtype)
        rank, place = _descend(rank, place, below, width)
    unset = jnp.max(jnp.where(mask, 0, lax.iota(place.dtype, len(mask))))
    # The compiler would compute the walk again for each use.
    return lax.optimization_barrier(jnp.where(exists, place, unset))


def _descend(rank, place, count, step: int):
    """To the part at `place`, which holds `count` of the set bits, or to the next, `step` later."""
    beyond = rank >= count
    return jnp.where(beyond, rank - count, rank), jnp.where(beyond, place + step, place)


def _words(mask: Bool[Array, "n"]) -> UInt32[Array, "w"]:
    """The mask with one bit for each place."""
    bits = jnp.pad(mask, (0, -len(mask) % WORD)).reshape(-1, WORD).astype(jnp.uint32)
    return jnp.sum(bits << np.arange(WORD, dtype=np.uint32)[None], axis=1, dtype=jnp.uint32)


def _lowest(excess: Float[Array, "n"], reached: Bool[Array, "n"], count: int) -> Bool[Array, "n"]:
    """All within reach, or where these are more than `count` the lowest; of equals the first."""
    zero = jnp.zeros_like(excess[0])
    order = lax.iota(excess.dtype, len(excess))
    few = lambda mask: jnp.sum(mask) <= count  # noqa: E731
    below = lambda limit: ~(excess >= limit)  # noqa: E731
    crowded = ~few(reached)
    lowest = jnp.min(jnp.where(excess < 0, excess, zero))
    low, high = _bisected(lambda limit: few(below(limit)), lowest, zero, crowded)
    first = lambda number: below(low) | below(high) & (order < number)  # noqa: E731
    number, _ = _bisected(lambda number: few(first(number)), zero, zero + len(excess), crowded)
    return jnp.where(crowded, first(number), reached)


def _bisected(holds, low, high, wanted):
    """Neighbouring numbers, at the first of which it still holds, where that is wanted."""

    def narrow(bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        there = holds(middle)
        return jnp.where(there, middle, low), jnp.where(there, high, middle)

    def wide(bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        return wanted & (low < middle) & (middle < high)

    return lax.while_loop(wide, narrow, (low, high))
