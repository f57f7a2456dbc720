"""Contacts of an environment from the poses of its geoms.

With few candidates, every pair has its own contact slots and geom ids are static. With many (see
`Candidates.dynamic`), contacts are computed only for pairs that a lower bound on their distance
does not rule out. The active contacts are then assigned to the slots, the deepest ones if there are
too many, and geom ids are traced. In kernels for CPUs, a loop goes through the pairs within reach
(`live`).
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.arrays.memo import is_traced
from jaxsim.collision.bounds import distance_bound
from jaxsim.collision.candidates import Candidates, PairGroup
from jaxsim.collision.contact import Contact
from jaxsim.collision.evaluation import contacts_of_groups, join_ids, take_shapes
from jaxsim.collision.live import live_contacts
from jaxsim.collision.parameters import adhesive_reach, contact_parameters, contact_reach
from jaxsim.collision.selection import within_reach
from jaxsim.collision.shapes import Contacts, Shape
from jaxsim.collision.table import PAIRS
from jaxsim.lanes.alternative import kernel_alternative
from jaxsim.lanes.switch import tracing_cpu_kernel

# Lower bounds are computed for all combinations of the first and second geoms if these are at most
# this factor times the candidates. This reads the data of each geom once, without gathers for
# pairs.
TABLE = 4


@dataclasses.dataclass
class _Slots:
    """Geometry of contact slots, and the geoms and explicit pair of each."""

    contacts: Contacts
    frame: Float[Array, "n 3 3"]
    geom1: Index
    geom2: Index
    pair: Index


def detect(
    model: Any,
    candidates: Candidates,
    geom_xpos: Float[Array, "ngeom 3"],
    geom_xmat: Float[Array, "ngeom 3 3"],
) -> Contact:
    """Contacts of the candidate pairs of a model.

    Args:
      model: the model; its `geom_size` and contact parameters are read.
      candidates: the pairs, from `find_candidates`.
      geom_xpos: positions of the geoms, world frame.
      geom_xmat: orientations of the geoms, geom to world.

    Returns:
      Contacts in `candidates.ncon` slots, ordered by kind. Distances, positions and frames are
      differentiable with respect to poses and sizes, parameters with respect to the model.
    """
    shapes = Shape(geom_xpos, geom_xmat, jnp.asarray(model.geom_size, geom_xpos.dtype))
    kinds = _kinds(candidates)
    # Its numbers are part of the loops' programs.
    loops = tracing_cpu_kernel() and not is_traced(model)
    at_once = [kind for kind in kinds if not (loops and kind.selects)]
    of_groups = iter(_slots_of_groups(model, at_once, shapes))
    parts, overflow = [], jnp.zeros((), int)
    for kind in kinds:
        if loops and kind.selects:
            slots, lost = _by_loop(model, kind, shapes)
        else:
            slots, lost = _deepest_of(model, [next(of_groups) for _ in kind.pairs], kind.slots)
        overflow = overflow + lost
        parts.append(slots)
    slots = _joined(parts) if parts else _empty(geom_xpos.dtype)
    values = contact_parameters(model, slots.geom1, slots.geom2, slots.pair)
    return Contact(
        dist=slots.contacts.dist,
        pos=slots.contacts.pos,
        frame=slots.frame,
        **_fields(values),
        geom1=slots.geom1,
        geom2=slots.geom2,
        pair=slots.pair,
        overflow=overflow,
        ranges=candidates.ranges,
    )


@dataclasses.dataclass
class _Kind:
    """Candidates of one kind of contact.

    Attributes:
      pairs: the groups, and the number of pairs of each whose contacts are computed at a time.
      slots: number of slots.
    """

    pairs: list[tuple[PairGroup, int]]
    slots: int

    @property
    def selects(self) -> bool:
        """Whether there are fewer slots than possible contacts."""
        return self.slots < sum(len(group) * group.slots_per_pair for group, _ in self.pairs)


def _kinds(candidates: Candidates) -> list[_Kind]:
    counts = iter(candidates.pairs())
    kinds = [[(g, next(counts)) for g in groups] for groups in candidates.by_kind().values()]
    return [_Kind(*both) for both in zip(kinds, candidates.slots(), strict=True)]


def _by_loop(model: Any, kind: _Kind, shapes: Shape) -> tuple[_Slots, Int[Array, ""] | int]:
    """The deepest active contacts of a kind, found in a loop over the pairs within reach."""
    groups = [group for group, _ in kind.pairs]
    ids = [np.concatenate([getattr(g, name) for g in groups]) for name in _IDS]

    def loop(shapes):
        reach = [_reach(model, g.geom1, g.geom2, g.pair).astype(shapes.pos.dtype) for g in groups]
        found = live_contacts(model, groups, shapes, reach, kind.slots)
        lost = found.lost + jnp.maximum(found.count - kind.slots, 0)
        chosen = [jnp.asarray(i)[found.pair] for i in ids]
        return found.contacts, found.contacts.frame, chosen, lost

    def at_once(shapes):
        slots, lost = _deepest_of(model, _slots_of_groups(model, [kind], shapes), kind.slots)
        chosen = [jnp.asarray(getattr(slots, name)) for name in _IDS]
        return slots.contacts, slots.frame, chosen, jnp.asarray(lost)

    contacts, frame, chosen, lost = kernel_alternative(loop, at_once)(shapes)
    ids = [
        np.full(kind.slots, i[0]) if _all_equal(i) else c for i, c in zip(ids, chosen, strict=True)
    ]
    return _Slots(contacts, frame, *ids), lost


def _slots_of_groups(
    model: Any, kinds: Sequence[_Kind], shapes: Shape
) -> list[tuple[_Slots, Int[Array, ""] | int]]:
    """The slots of each group, and how many other contacts there might be."""
    groups = [group for kind in kinds for group, _ in kind.pairs]
    chosen = [_pairs(model, *pair, shapes) for kind in kinds for pair in kind.pairs]
    selects = [kind.selects for kind in kinds for _ in kind.pairs]
    # Contacts out of reach have no slot where some are selected, and a use where none are.
    reach = [
        _reach(model, *ids) if some else None
        for (ids, _), some in zip(chosen, selects, strict=True)
    ]
    contacts = contacts_of_groups(model, groups, shapes, [ids for ids, _ in chosen], reach)
    return [
        _in_slots(model, group, ids, lost, found)
        for group, (ids, lost), found in zip(groups, chosen, contacts, strict=True)
    ]


def _pairs(
    model: Any, group: PairGroup, count: int, shapes: Shape
) -> tuple[tuple[Index, Index, Index], Int[Array, ""] | int]:
    """Ids of `count` pairs of a group, and how many others are within reach."""
    ids = group.geom1, group.geom2, group.pair
    if count == len(group):
        return ids, 0
    # The selection of pairs has no derivative.
    chosen, lost = within_reach(_excess(model, group, shapes), count)
    first, second, pair = (_take_ids(i, chosen) for i in ids)
    return (first, second, pair), lost


def number_within_reach(
    model: Any,
    group: PairGroup,
    geom_xpos: Float[Array, "ngeom 3"],
    geom_xmat: Float[Array, "ngeom 3 3"],
) -> Int[Array, ""]:
    """How many pairs of a group have bounding volumes that overlap."""
    shapes = Shape(geom_xpos, geom_xmat, jnp.asarray(model.geom_size, geom_xpos.dtype))
    return jnp.sum(~(_excess(model, group, shapes) >= 0))


def _excess(model: Any, group: PairGroup, shapes: Shape) -> Float[Array, "n"]:
    """Lower bounds on the distances of a group's pairs, minus their reach."""
    reach = _reach(model, group.geom1, group.geom2, group.pair)
    return lax.stop_gradient(_distance_bounds(group, shapes) - reach)


def _in_slots(
    model: Any, group: PairGroup, ids: tuple[Index, ...], lost: Any, contacts: Contacts
) -> tuple[_Slots, Int[Array, ""] | int]:
    """The contacts of pairs as slots, and `lost` with those for which a pair has no slot."""
    if contacts.others is not None:
        others, contacts = contacts.others, contacts.replace(others=None)
        lost = lost + jnp.sum(others < adhesive_reach(model, *ids)[:, None])
    frame = jax.vmap(lambda c: c.frame)(contacts)

    def of_slots(x):
        spread = jnp.broadcast_to(x, (*contacts.dist.shape, *x.shape[2:]))
        return spread.reshape(-1, *x.shape[2:])

    geometry = jax.tree.map(of_slots, (contacts, frame))
    return _Slots(*geometry, *(i.repeat(PAIRS[group.types].max_contacts) for i in ids)), lost


def _reach(model: Any, *ids: Index) -> Float[Array, "n"]:
    """Distance below which a contact has a use; actuators and geoms pull in the gap, too."""
    adhesive = (model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_BODY)).any()
    return (contact_reach if adhesive else adhesive_reach)(model, *ids)


def _distance_bounds(group: PairGroup, shapes: Shape) -> Float[Array, "n"]:
    """Lower bounds on the distances of a group's pairs."""
    bound = functools.partial(distance_bound, group.types)
    first, row = np.unique(group.geom1, return_inverse=True)
    second, column = np.unique(group.geom2, return_inverse=True)
    if len(first) * len(second) > TABLE * len(group):
        return jax.vmap(bound)(take_shapes(shapes, group.geom1), take_shapes(shapes, group.geom2))
    of_first = jax.vmap(bound, in_axes=(None, 0))
    table = jax.vmap(of_first, in_axes=(0, None))(
        take_shapes(shapes, first), take_shapes(shapes, second)
    )
    # XLA would otherwise recompute it for each use.
    table = lax.optimization_barrier(table)
    return gather(table.reshape(-1), row * len(second) + column)


def _deepest_of(
    model: Any, found: Sequence[tuple[_Slots, Int[Array, ""] | int]], count: int
) -> tuple[_Slots, Int[Array, ""] | int]:
    """The deepest slots of some groups, and the number of contacts that are lost."""
    slots, lost = _deepest(model, _joined([slots for slots, _ in found]), count)
    return slots, lost + sum(n for _, n in found)


def _deepest(model: Any, slots: _Slots, count: int) -> tuple[_Slots, Int[Array, ""] | int]:
    """The active slots, at most the `count` deepest, and how many others are active."""
    dist = slots.contacts.dist
    if len(dist) <= count:
        return slots, 0
    margin = _reach(model, slots.geom1, slots.geom2, slots.pair)
    chosen, lost = within_reach(lax.stop_gradient(dist - margin.astype(dist.dtype)), count)
    # XLA would otherwise compute each chosen slot anew, from the poses on.
    contacts = jax.tree.map(lambda x: x[chosen], lax.optimization_barrier(slots.contacts))
    ids = (_take_ids(getattr(slots, name), chosen) for name in _IDS)
    # Frames of the chosen slots only; XLA then removes the computation of all others.
    return _Slots(contacts, contacts.frame, *ids), lost


def _joined(parts: list[_Slots]) -> _Slots:
    geometry = [(p.contacts, p.frame) for p in parts]
    contacts, frame = jax.tree.map(lambda *x: jnp.concatenate(x), *geometry)
    return _Slots(contacts, frame, *(join_ids([getattr(p, n) for p in parts]) for n in _IDS))


_IDS = ("geom1", "geom2", "pair")


def _take_ids(ids: Index, chosen: Int[Array, "k"]) -> Any:
    """The chosen ids; static if all ids are equal, as those of a floor, which avoids gathers."""
    return np.full(len(chosen), ids[0]) if _all_equal(ids) else jnp.asarray(ids)[chosen]


def _all_equal(ids: Index) -> bool:
    return isinstance(ids, np.ndarray) and len(set(ids.tolist())) == 1


def _empty(dtype) -> _Slots:
    dist, pos = jnp.zeros(0, dtype), jnp.zeros((0, 3), dtype)
    contacts = Contacts(dist, pos, normal=pos, tangent=pos)
    return _Slots(contacts, contacts.frame, *(np.zeros(0, int) for _ in _IDS))


def _fields(record) -> dict[str, Any]:
    return {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
