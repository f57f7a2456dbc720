"""How a batch is divided: chunks whose working set stays in a CPU's cache, one thread for each."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.collision import model_candidates
from jaxsim.model import Model
from jaxsim.parallel.cpu import keeps_loops


@dataclasses.dataclass(frozen=True)
class Limits:
    """How many lanes a chunk should have.

    Its working set should stay in cache: so many links, of which a contact counts as two, in all
    lanes together, within limits below which the vectors are too short and above which nothing is
    gained.
    """

    cached_links: int
    min_lanes: int
    max_lanes: int


# A loop over few lanes that XLA unrolls does not become vectors; one that it keeps does, and then
# a chunk can be as small as the first-level cache wants it.
UNROLLED, KEPT = Limits(*tuning.CHUNK_UNROLLED), Limits(*tuning.CHUNK_KEPT)


def lane_limits() -> Limits:
    """What holds for this process; see `configure_cpu`."""
    return KEPT if keeps_loops() else UNROLLED


def chunk_lanes(model: Model) -> int:
    """How many environments of a model a CPU should step together."""
    limits = lane_limits()
    contacts = model_candidates(model).ncon
    vectors = limits.cached_links // max(model.njnt + 2 * contacts, 1) // tuning.VECTOR
    lanes = vectors * tuning.VECTOR
    return max(limits.min_lanes, min(limits.max_lanes, lanes))


def even_lanes(model: Model, count: int) -> int:
    """How many of `count` environments to step together: all, or on a CPU an even part of them."""
    limit = chunk_lanes(model)
    if jax.default_backend() != "cpu" or count <= limit:
        return count
    # Short vectors cost more than a cache that is too small.
    parts = [n for n in range(lane_limits().min_lanes, limit + 1) if count % n == 0]
    return max(parts, key=lambda n: (n % tuning.VECTOR == 0, n), default=count)


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
