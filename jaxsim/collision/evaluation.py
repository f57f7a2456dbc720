"""Contacts of pairs of geoms: pair functions, applied to arrays of pairs."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.blocks import block_pairs, close_pairs, contacts_in_blocks, contacts_in_turn
from jaxsim.collision.candidates import PairGroup
from jaxsim.collision.fields import Fields
from jaxsim.collision.hulls import Hulls
from jaxsim.collision.parameters import contact_reach
from jaxsim.collision.sdf import SignedDistances
from jaxsim.collision.shapes import Contacts, Shape
from jaxsim.collision.table import HFIELD, MESH, PAIRS, PLANE, SDF
from jaxsim.lanes.switch import tracing_cpu_kernel


def contacts_of_groups(
    model: Any,
    groups: Sequence[PairGroup],
    shapes: Shape,
    ids: Sequence[tuple[Index, ...]],
    reach: Sequence[Float[Array, "_"] | None],
) -> list[Contacts]:
    """The contacts of some pairs of each group.

    Groups whose programs are large are evaluated together if they differ only in kind.

    Args:
      model: the model.
      groups: groups of pairs.
      shapes: shapes of all geoms.
      ids: geoms and numbers of the explicit pairs of some pairs of each group.
      reach: distances from which on contacts of these pairs have no use, and may be left out (m);
        None if all have a use.
    """
    together: dict[Any, list[int]] = {}
    for k, group in enumerate(groups):
        together.setdefault(group.types if PAIRS[group.types].large else k, []).append(k)
    found = {}
    for members in together.values():
        group = _union([groups[k] for k in members])
        joined = [join_ids([ids[k][i] for k in members]) for i in range(3)]
        limits = [_limit(reach[k], len(ids[k][0])) for k in members]
        idle = sum(len(ids[k][0]) for k in members if reach[k] is not None)
        if tracing_cpu_kernel() and _has_hulls(group) and len(joined[0]) > 1:
            contacts = _of_close(
                contacts_in_turn, model, group, shapes, joined, jnp.concatenate(limits)
            )
        elif idle > block_pairs() and _has_hulls(group) and group.types[0] != PLANE:
            contacts = _of_close(
                contacts_in_blocks, model, group, shapes, joined, jnp.concatenate(limits)
            )
        else:
            contacts = pair_contacts(model, PAIRS[group.types].function, group, shapes, joined)
        stops = np.cumsum([len(ids[k][0]) for k in members])
        for k, start, stop in zip(members, [0, *stops], stops, strict=False):
            found[k] = jax.tree.map(lambda x, a=start, b=stop: x[a:b], contacts)
    return [found[k] for k in range(len(groups))]


def _limit(reach: Float[Array, "n"] | None, count: int) -> Float[Array, "n"]:
    return jnp.full(count, jnp.inf) if reach is None else reach


def _of_close(
    contacts_of: Callable[..., Contacts],
    model: Any,
    group: PairGroup,
    shapes: Shape,
    ids: Sequence[Index],
    reach: Float[Array, "n"],
) -> Contacts:
    """The contacts of the pairs that may have some within reach, one by one or in blocks."""
    pair = PAIRS[group.types]
    contacts = functools.partial(pair_contacts, model, pair.function, group, shapes)
    first, second = (take_shapes(shapes, i) for i in ids[:2])
    close = close_pairs(group.types, first, second, reach)
    return contacts_of(contacts, Contacts.none(pair.max_contacts, shapes.pos.dtype), ids, close)


def _has_hulls(group: PairGroup) -> bool:
    return MESH in group.types and HFIELD not in group.types and SDF not in group.types


def _union(groups: Sequence[PairGroup]) -> PairGroup:
    """The pairs of several groups, which may be of several kinds."""
    if len(groups) == 1:
        return groups[0]
    ids = (
        np.concatenate([getattr(g, name) for g in groups]) for name in ("geom1", "geom2", "pair")
    )
    return PairGroup(groups[0].types, groups[0].kind, *ids)


def pair_contacts(
    model: Any,
    function: Callable[[Shape, Shape], Contacts],
    group: PairGroup,
    shapes: Shape,
    ids: Sequence[Index],
) -> Contacts:
    """The contacts of some pairs of a group, given by geoms and the number of an explicit pair.

    Each of `ids` is an array, or the single number of one pair.
    """
    tables, (*geoms, _) = _tables(model, group, shapes.pos.dtype), ids
    pair = zip(tables, geoms, strict=True)
    rows = [jnp.zeros(jnp.shape(i), int) if table is None else table.rows(i) for table, i in pair]

    def contacts(*posed: tuple[Shape, Any]) -> Contacts:
        pair = zip(tables, posed, strict=True)
        return function(
            *(
                shape if table is None else table.complete(shape, row)
                for table, (shape, row) in pair
            )
        )

    first, second = (take_shapes(shapes, i) for i in geoms)
    if PAIRS[group.types].to_margin:
        margin = contact_reach(model, *ids).astype(first.pos.dtype)
        first = first.replace(margin=lax.stop_gradient(margin))
    posed = zip((first, second), rows, strict=True)
    return jax.vmap(contacts)(*posed) if jnp.ndim(geoms[0]) else contacts(*posed)


def _tables(model: Any, group: PairGroup, dtype) -> list[Hulls | Fields | SignedDistances | None]:
    """Tables of hulls, fields or functions for the first and second geoms; None for primitives."""
    first = Fields(model, group.geom1, group.geom2, dtype) if group.types[0] == HFIELD else None
    sides = zip(group.types, (group.geom1, group.geom2), strict=True)
    makers = {
        MESH: lambda geoms: Hulls(model, geoms, dtype),
        SDF: lambda geoms: SignedDistances(model, geoms),
    }
    tables = [makers[kind](geoms) if kind in makers else None for kind, geoms in sides]
    return [first or tables[0], tables[1]]


def join_ids(ids: list[Int[Array, "_"] | np.ndarray]) -> Index:
    """One array of several."""
    # Static ids stay static, so that the solver can choose its structure from them.
    static = all(isinstance(i, np.ndarray) for i in ids)
    return np.concatenate(ids) if static else jnp.concatenate(ids)


def take_shapes(shapes: Shape, index: Index) -> Shape:
    """The shapes of some geoms."""
    return jax.tree.map(lambda x: gather(x, index), shapes)
