"""Contacts of an environment from the poses of its geoms.

With few candidates, every pair has its own contact slots and geom ids are static. With many (see
`Candidates.dynamic`), contacts are computed only for pairs that a lower bound on their distance
does not rule out. The active contacts are then assigned to the slots, the deepest ones if there are
too many, and geom ids are traced.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.bounds import distance_bound
from jaxsim.collision.candidates import Candidates, PairGroup
from jaxsim.collision.contact import Contact
from jaxsim.collision.fields import Fields
from jaxsim.collision.hulls import Hulls
from jaxsim.collision.parameters import contact_margin, contact_parameters, contact_reach
from jaxsim.collision.selection import within_reach
from jaxsim.collision.shapes import Contacts, Shape
from jaxsim.collision.table import HFIELD, MESH, PAIRS

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
    parts, overflow = [], jnp.zeros((), int)
    limits = iter(candidates.pairs())
    for span, groups in zip(candidates.ranges, candidates.by_kind().values(), strict=True):
        found = [_evaluate(model, group, shapes, next(limits)) for group in groups]
        slots, lost = _deepest(model, _joined([s for s, _ in found]), span.stop - span.start)
        overflow = overflow + lost + sum(n for _, n in found)
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


def _evaluate(
    model: Any, group: PairGroup, shapes: Shape, count: int
) -> tuple[_Slots, Int[Array, ""] | int]:
    """Contacts of `count` pairs of a group, and how many others there might be."""
    ids, lost = (group.geom1, group.geom2, group.pair), 0
    if count < len(group):
        # The selection of pairs has no derivative.
        excess = lax.stop_gradient(_distance_bounds(group, shapes) - _reach(model, *ids))
        chosen, lost = within_reach(excess, count)
        ids = tuple(_take_ids(i, chosen) for i in ids)
    entry = PAIRS[group.types]
    contacts = pair_contacts(model, entry.function, group, shapes, ids[:2])
    if contacts.others is not None:
        others, contacts = contacts.others, contacts.replace(others=None)
        lost = lost + jnp.sum(others < contact_margin(model, *ids)[:, None])
    frame = jax.vmap(lambda c: c.frame)(contacts)

    def of_slots(x):
        spread = jnp.broadcast_to(x, (*contacts.dist.shape, *x.shape[2:]))
        return spread.reshape(-1, *x.shape[2:])

    geometry = jax.tree.map(of_slots, (contacts, frame))
    return _Slots(*geometry, *(i.repeat(entry.max_contacts) for i in ids)), lost


def _reach(model: Any, *ids: Index) -> Float[Array, "n"]:
    """Distance below which a contact has a use; adhesion acts in the gap, too."""
    adhesive = (model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_BODY)).any()
    return (contact_reach if adhesive else contact_margin)(model, *ids)


def pair_contacts(
    model: Any,
    function: Callable[[Shape, Shape], Contacts],
    group: PairGroup,
    shapes: Shape,
    geoms: Sequence[Index],
) -> Contacts:
    """The contacts of some pairs of a group."""
    tables = _tables(model, group, shapes.pos.dtype)
    pair = zip(tables, geoms, strict=True)
    rows = [jnp.zeros(len(i), int) if table is None else table.rows(i) for table, i in pair]

    def contacts(*posed: tuple[Shape, Any]) -> Contacts:
        pair = zip(tables, posed, strict=True)
        return function(
            *(
                shape if table is None else table.complete(shape, row)
                for table, (shape, row) in pair
            )
        )

    return jax.vmap(contacts)(*((_take(shapes, i), r) for i, r in zip(geoms, rows, strict=True)))


def _tables(model: Any, group: PairGroup, dtype) -> list[Hulls | Fields | None]:
    """Tables of hulls or height fields for the first and the second geoms; None for primitives."""
    first = Fields(model, group.geom1, group.geom2, dtype) if group.types[0] == HFIELD else None
    sides = zip(group.types, (group.geom1, group.geom2), strict=True)
    hulls = [Hulls(model, geoms, dtype) if kind == MESH else None for kind, geoms in sides]
    return [first or hulls[0], hulls[1]]


def _distance_bounds(group: PairGroup, shapes: Shape) -> Float[Array, "n"]:
    """Lower bounds on the distances of a group's pairs."""
    bound = functools.partial(distance_bound, group.types)
    first, row = np.unique(group.geom1, return_inverse=True)
    second, column = np.unique(group.geom2, return_inverse=True)
    if len(first) * len(second) > TABLE * len(group):
        return jax.vmap(bound)(_take(shapes, group.geom1), _take(shapes, group.geom2))
    of_first = jax.vmap(bound, in_axes=(None, 0))
    table = jax.vmap(of_first, in_axes=(0, None))(_take(shapes, first), _take(shapes, second))
    # XLA would otherwise recompute it for each use.
    table = lax.optimization_barrier(table)
    return gather(table.reshape(-1), row * len(second) + column)


def _deepest(model: Any, slots: _Slots, count: int) -> tuple[_Slots, Int[Array, ""] | int]:
    """The active slots, at most the `count` deepest, and how many others are active."""
    dist = slots.contacts.dist
    if len(dist) <= count:
        return slots, 0
    margin = _reach(model, slots.geom1, slots.geom2, slots.pair)
    chosen, lost = within_reach(lax.stop_gradient(dist - margin.astype(dist.dtype)), count)
    contacts = jax.tree.map(lambda x: x[chosen], slots.contacts)
    ids = (_take_ids(getattr(slots, name), chosen) for name in _IDS)
    # Frames of the chosen slots only; XLA then removes the computation of all others.
    return _Slots(contacts, contacts.frame, *ids), lost


def _joined(parts: list[_Slots]) -> _Slots:
    geometry = [(p.contacts, p.frame) for p in parts]
    contacts, frame = jax.tree.map(lambda *x: jnp.concatenate(x), *geometry)
    return _Slots(contacts, frame, *(_join_ids([getattr(p, n) for p in parts]) for n in _IDS))


_IDS = ("geom1", "geom2", "pair")


def _join_ids(ids: list[Int[Array, "_"] | np.ndarray]) -> Index:
    # Static ids stay static, so that the solver can choose its structure from them.
    static = all(isinstance(i, np.ndarray) for i in ids)
    return np.concatenate(ids) if static else jnp.concatenate(ids)


def _take_ids(ids: Index, chosen: Int[Array, "k"]) -> Any:
    """The chosen ids; static if all ids are equal, as those of a floor, which avoids gathers."""
    if isinstance(ids, np.ndarray) and len(set(ids.tolist())) == 1:
        return np.full(chosen.shape[0], ids[0])
    return jnp.asarray(ids)[chosen]


def _empty(dtype) -> _Slots:
    dist, pos = jnp.zeros(0, dtype), jnp.zeros((0, 3), dtype)
    contacts = Contacts(dist, pos, normal=pos, tangent=pos)
    return _Slots(contacts, contacts.frame, *(np.zeros(0, int) for _ in _IDS))


def _take(shapes: Shape, index: Index) -> Shape:
    return jax.tree.map(lambda x: gather(x, index), shapes)


def _fields(record) -> dict[str, Any]:
    return {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
