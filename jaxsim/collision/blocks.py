"""Contacts of many pairs of which few are close, a block of pairs at a time.

Pairs that a lower bound on their distance does not rule out come first, and the loop skips the
blocks without one. So memory is that of a block, and time follows the pairs that are close. The
loop has a fixed length, and derivatives in both modes.
"""

import functools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.indexing import Index
from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.collision.bounds import distance_bound
from jaxsim.collision.selection import set_indices
from jaxsim.collision.shapes import Contacts, Shape

# Number of pairs whose contacts are computed at a time: those of a block are all computed if one of
# them is close in any environment of a batch. A GPU may wait for its host before each block.
BLOCK, BLOCK_OF_GPU = 2, 8


def block_pairs() -> int:
    """The number of pairs of a block on this device."""
    return BLOCK if jax.default_backend() == "cpu" else BLOCK_OF_GPU


def close_pairs(
    types: tuple[int, int], first: Shape, second: Shape, reach: Float[Array, "n"]
) -> Bool[Array, "n"]:
    """Pairs of shapes that may have contacts with distances below `reach` (m)."""
    bounds = jax.vmap(functools.partial(distance_bound, types))(first, second)
    # NaN counts as close, so that it is not lost.
    return ~(lax.stop_gradient(bounds - reach.astype(bounds.dtype)) >= 0)


def contacts_in_blocks(
    contacts: Callable[[Sequence[Int[Array, "b"]]], Contacts],
    none: Contacts,
    ids: Sequence[Index],
    close: Bool[Array, "n"],
) -> Contacts:
    """Contacts of the pairs that are close; all others have the distance `INACTIVE`.

    Args:
      contacts: from arrays of ids of some pairs to their contacts.
      none: contacts of one pair that has none.
      ids: ids of all pairs.
      close: which of them are close.
    """
    count, size = len(close), block_pairs()
    blocks = -(-count // size)
    order = jnp.pad(set_indices(close, count), (0, blocks * size - count), mode="edge")
    block_ids = [jnp.asarray(i)[order].reshape(blocks, size) for i in ids]
    wanted = size * np.arange(blocks) < jnp.sum(close)

    def of_block(_, block):
        wanted, *own = block
        nothing = lambda: jax.tree.map(lambda x: jnp.stack([x] * size), none)  # noqa: E731
        return None, lax.cond(any_in_batch(wanted), lambda: contacts(own), nothing)

    _, found = lax.scan(of_block, None, (wanted, *block_ids))
    found = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)
    place = jnp.maximum(jnp.cumsum(close) - 1, 0)

    def placed(some, none):
        mask = close.reshape(-1, *(1,) * (some.ndim - 1))
        return jnp.where(mask, some[place], none[None])

    return jax.tree.map(placed, found, none)


def contacts_in_turn(
    contacts: Callable[[Sequence[Int[Array, ""]]], Contacts],
    none: Contacts,
    ids: Sequence[Index],
    close: Bool[Array, "n"],
) -> Contacts:
    """The same in a kernel, whose code is that of one pair.

    Args:
      contacts: from the ids of one pair to its contacts.
      none: contacts of one pair that has none.
      ids: ids of all pairs.
      close: which of them are close.
    """

    def of_pair(_, pair):
        close, *own = pair
        found = lax.cond(any_in_batch(close), lambda: contacts(own), lambda: none)
        return None, jax.tree.map(lambda x, y: jnp.where(close, x, y), found, none)

    return lax.scan(of_pair, None, (close, *(jnp.asarray(i) for i in ids)))[1]
