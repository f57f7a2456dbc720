"""Division of a batch into chunks whose working set fits in a CPU's cache."""

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
    """Limits on the number of lanes of a chunk.

    The working set of a chunk, measured as links times lanes, should fit in the cache; a contact
    counts as two links. Fewer lanes than the minimum make vectors too short, and more than the
    maximum gain nothing.
    """

    cached_links: int
    min_lanes: int
    max_lanes: int


# XLA unrolls loops over few lanes, which are then not vectorised. If it is told not to, chunks can
# be small enough for the first-level cache.
UNROLLED, KEPT = Limits(*tuning.CHUNK_UNROLLED), Limits(*tuning.CHUNK_KEPT)


def lane_limits() -> Limits:
    """The limits for this process; see `configure_cpu`."""
    return KEPT if keeps_loops() else UNROLLED


def chunk_lanes(model: Model) -> int:
    """Number of environments of a model in a chunk on a CPU."""
    limits = lane_limits()
    contacts = model_candidates(model).ncon
    vectors = limits.cached_links // max(model.njnt + 2 * contacts, 1) // tuning.VECTOR
    lanes = vectors * tuning.VECTOR
    return max(limits.min_lanes, min(limits.max_lanes, lanes))


def even_lanes(model: Model, count: int) -> int:
    """Number of lanes for `count` environments: all, or on a CPU chunks of equal size."""
    limit = chunk_lanes(model)
    if jax.default_backend() != "cpu" or count <= limit:
        return count
    # Vectors that are too short cost more than cache misses.
    parts = [n for n in range(lane_limits().min_lanes, limit + 1) if count % n == 0]
    return max(parts, key=lambda n: (n % tuning.VECTOR == 0, n), default=count)


def map_chunks(f: Callable, lanes: int, *trees: Any) -> Any:
    """Apply f to chunks of `lanes` environments, one after the other.

    Args:
      f: function of pytrees with a leading axis of `lanes` environments, to such a pytree.
      lanes: number of environments in a chunk; it must divide their total number.
      *trees: arguments of f, with a leading axis of all environments.
    """
    count = jax.tree.leaves(trees)[0].shape[0]
    if count == lanes:
        return f(*trees)
    split = jax.tree.map(lambda x: x.reshape(count // lanes, lanes, *x.shape[1:]), trees)
    out = lax.map(lambda chunk: f(*chunk), split)
    return jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), out)
