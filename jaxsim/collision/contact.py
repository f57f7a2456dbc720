"""`Contact`: everything that the constraint solver needs to know about the contacts."""

import dataclasses
from typing import NamedTuple

import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float, Int


class ContactKind(NamedTuple):
    """What is known of a contact before it happens.

    Attributes:
      condim: its dimension.
      movable: whether its first and its second geom have degrees of freedom.
    """

    condim: int
    movable: tuple[bool, bool]


@dataclasses.dataclass(frozen=True)
class SlotRange:
    """Contact slots `start:stop`, which are all of one kind."""

    start: int
    stop: int
    kind: ContactKind

    @property
    def condim(self) -> int:
        """Dimension of the contacts."""
        return self.kind.condim

    @property
    def slots(self) -> slice:
        """The range as a slice of the contact arrays."""
        return slice(self.start, self.stop)


@struct.dataclass
class Contact:
    """Contact slots of one environment, with MuJoCo's names.

    The number of slots is fixed by the model; a slot generates force only where `active`.

    Attributes:
      dist: signed distance between the surfaces.
      pos: contact point in the world.
      frame: rows are the normal, from geom1 to geom2, and two tangents.
      includemargin: a contact is active below this distance.
      friction: two tangential, one torsional and two rolling coefficients.
      solref: reference of the normal direction.
      solreffriction: reference of the friction directions; zeros mean that `solref` is used.
      solimp: impedance.
      geom1: first geom. A numpy array (static) when every candidate has its own slots, traced when
        slots are assigned at run time.
      geom2: second geom, likewise.
      pair: index of the explicit <pair> that made the contact, -1 for the others, likewise.
      overflow: number of contacts that did not fit into the slots; may also count contacts that a
        bounding volume could not rule out, so 0 guarantees that nothing was lost.
      ranges: consecutive ranges of slots of one kind each.
    """

    dist: Float[Array, "nc"]
    pos: Float[Array, "nc 3"]
    frame: Float[Array, "nc 3 3"]
    includemargin: Float[Array, "nc"]
    friction: Float[Array, "nc 5"]
    solref: Float[Array, "nc 2"]
    solreffriction: Float[Array, "nc 2"]
    solimp: Float[Array, "nc 5"]
    geom1: Int[Array, "nc"] | np.ndarray
    geom2: Int[Array, "nc"] | np.ndarray
    pair: Int[Array, "nc"] | np.ndarray
    overflow: Int[Array, ""]
    ranges: tuple[SlotRange, ...] = struct.field(pytree_node=False)

    @property
    def active(self) -> Bool[Array, "nc"]:
        """Slots that generate force: closer than the margin. The gap plays no part."""
        return self.dist < self.includemargin

    @property
    def condim(self) -> np.ndarray:
        """Dimension of each slot (static)."""
        return np.repeat([r.condim for r in self.ranges], [r.stop - r.start for r in self.ranges])
