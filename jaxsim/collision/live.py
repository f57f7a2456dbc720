"""Contacts of the pairs within reach, one pair after the other.

A program has the exact geometry of each pair of shapes once, and computes it as often as there are
pairs within reach. Lower bounds on distances are computed for blocks of pairs. Active contacts are
put into the slots as they are found.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.collision.bounds import distance_bound
from jaxsim.collision.candidates import PairGroup
from jaxsim.collision.evaluation import pair_contacts, take_shapes
from jaxsim.collision.selection import WORD, for_each_set
from jaxsim.collision.shapes import Contacts, Shape
from jaxsim.collision.table import PAIRS


@struct.dataclass
class Found:
    """The contacts that are kept.

    Attributes:
      contacts: one in each slot; those without a contact have the distance `INACTIVE`.
      excess: distance minus reach of each.
      pair: the pair of each, counted through all groups.
      count: number of active contacts.
      lost: number of active contacts for which a pair has no slots.
    """

    contacts: Contacts
    excess: Float[Array, "n"]
    pair: Int[Array, "n"]
    count: Int[Array, ""]
    lost: Int[Array, ""]


def live_contacts(
    model: Any,
    groups: Sequence[PairGroup],
    shapes: Shape,
    reach: Sequence[Float[Array, "_"]],
    count: int,
) -> Found:
    """The active contacts of some groups, the `count` deepest if there are more.

    Args:
      model: the model.
      groups: groups of pairs.
      shapes: shapes of all geoms.
      reach: distances below which contacts of each group's pairs are active.
      count: number of slots.
    """
    found, first = _nothing(count, shapes.pos.dtype), 0
    for group, own in zip(groups, reach, strict=True):
        found = _of_group(model, group, shapes, own, first, found)
        first += len(group)
    return found


def _of_group(model: Any, group: PairGroup, shapes: Shape, reach, first: int, found: Found):
    """The contacts of a group added; its pairs are counted from `first`."""
    count = -(-len(group) // WORD)
    size = -(-len(group) // count)
    rest = count * size - len(group)
    geom1, geom2, pairs = (
        np.pad(ids, (0, rest), "edge") for ids in (group.geom1, group.geom2, group.pair)
    )
    reach = jnp.pad(reach, (0, rest), constant_values=-jnp.inf)  # so that the rest has no contacts
    bound = functools.partial(distance_bound, group.types)
    function = PAIRS[group.types].function

    def add(pair, found):
        chosen = [jnp.asarray(ids)[pair] for ids in (geom1, geom2, pairs)]
        contacts = pair_contacts(model, function, group, shapes, chosen)
        return _with_contacts(found, contacts, first + pair, reach[pair])

    def block(found, own):
        start, one, two, reach = own
        bounds = jax.vmap(bound)(take_shapes(shapes, one), take_shapes(shapes, two))
        near = ~(lax.stop_gradient(bounds) - reach >= 0)
        return for_each_set(near, lambda k, found: add(start + k, found), found)

    if count == 1:
        return block(found, (0, geom1, geom2, reach))
    starts = size * jnp.arange(count, dtype=jnp.int32)
    blocks = (starts, *(jnp.asarray(x).reshape(count, size) for x in (geom1, geom2, reach)))
    return lax.scan(lambda found, own: (block(found, own), None), found, blocks)[0]


def _nothing(count: int, dtype) -> Found:
    none, zero = Contacts.none(count, dtype), jnp.zeros((), jnp.int32)
    none = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *x.shape[1:])), none)
    return Found(none, none.dist, jnp.zeros(count, jnp.int32), zero, zero)


def _with_contacts(found: Found, contacts: Contacts, pair, reach) -> Found:
    """Those of a pair added, where they are active."""
    if contacts.others is not None:
        others = jnp.sum(contacts.others < reach, dtype=jnp.int32)
        found, contacts = found.replace(lost=found.lost + others), contacts.replace(others=None)
    number = len(contacts.dist)
    contacts = jax.tree.map(lambda x: jnp.broadcast_to(x, (number, *x.shape[1:])), contacts)
    active = ~(contacts.dist >= reach)

    def add(found):
        for k in range(number):
            contact = jax.tree.map(lambda x, k=k: x[k], contacts)
            found = _with_contact(found, contact, contact.dist - reach, pair, active[k])
        return found

    return lax.cond(any_in_batch(jnp.any(active)), add, lambda found: found, found)


def _with_contact(found: Found, contact: Contacts, excess, pair, active: Bool[Array, ""]) -> Found:
    """A contact in the next slot, or in place of the shallowest one if it is deeper."""
    slots = len(found.pair)
    full = active & (found.count >= slots)

    def shallowest(found):
        worst = jnp.argmax(found.excess).astype(jnp.int32)
        return jnp.where(excess < found.excess[worst], worst, slots)

    place = lax.cond(any_in_batch(full), shallowest, lambda found: found.count, found)
    place = jnp.where(full, place, jnp.where(active, found.count, slots))
    here = lax.iota(jnp.int32, slots) == place

    def put(old, new):
        return jnp.where(here.reshape(-1, *(1,) * new.ndim), new[None], old)

    return found.replace(
        contacts=jax.tree.map(put, found.contacts, contact),
        excess=put(found.excess, excess),
        pair=put(found.pair, pair),
        count=found.count + active,
    )
