"""How a batch is divided: chunks whose working set stays in a CPU's cache, one thread for each."""

from collections.abc import Callable
from typing import Any

import jax
from jax import lax

from jaxsim.collision import find_candidates
from jaxsim.model import Model

# The working set of a chunk should stay in a CPU's second-level cache: this many links, of which a
# contact counts as two, in all lanes together, within limits below which the vectors are too short
# and above which nothing is gained.
CACHED_LINKS, MIN_LANES, MAX_LANES = 12288, 64, 128
VECTOR = 16  # numbers of a processor's vector; other lanes are left over, and slow


def chunk_lanes(model: Model) -> int:
    """How many environments of a model a CPU should step together."""
    contacts = find_candidates(model, model.max_geom_pairs, model.max_contacts).ncon
    lanes = CACHED_LINKS // max(model.njnt + 2 * contacts, 1) // VECTOR * VECTOR
    return max(MIN_LANES, min(MAX_LANES, lanes))


def even_lanes(model: Model, count: int) -> int:
    """How many of `count` environments to step together: all, or on a CPU an even part of them."""
    limit = chunk_lanes(model)
    if jax.default_backend() != "cpu" or count <= limit:
        return count
    lanes = max(n for n in range(1, limit + 1) if count % n == 0)
    # Short vectors cost more than a cache that is too small.
    return lanes if lanes >= MIN_LANES else count


def map_chunks(f: Callable, lanes: int, *trees: Any) -> Any:
    """`f` of `lanes` environments after the other; `lanes` divides their number.

    Args:
      f: from trees with `lanes` environments in front to such trees.
      lanes: environments of a chunk.
      *trees: arguments of f, with all environments in front.
    """
    count = jax.tree.leaves(trees)[0].shape[0]
    if count == lanes:
        return f(*trees)
    split = jax.tree.map(lambda x: x.reshape(count // lanes, lanes, *x.shape[1:]), trees)
    out = lax.map(lambda chunk: f(*chunk), split)
    return jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), out)
