"""`Contact`: geometry and parameters of contacts, the input of the constraint solver."""

import dataclasses
from typing import NamedTuple

import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float, Int


class ContactKind(NamedTuple):
    """Static properties of contacts.

    Attributes:
      condim: dimension of the contact force: 1, 3, 4 or 6.
      movable: whether the first and the second geom are moved by joints.
    """

    condim: int
    movable: tuple[bool, bool]


@dataclasses.dataclass(frozen=True)
class SlotRange:
    """Contact slots `start:stop`, all of one kind."""

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

    The model fixes the number of slots nc. A slot holds a contact with force only where `active`.

    Attributes:
      dist: signed distance between the surfaces (m), negative for overlap.
      pos: contact point in world coordinates (m).
      frame: rows are the normal, from geom1 to geom2, and two tangents.
      includemargin: distance below which a contact is active (m).
      friction: two tangential, one torsional and two rolling coefficients.
      solref: `solref` of the normal direction.
      solreffriction: `solref` of the friction directions; zeros mean that `solref` is used.
      solimp: `solimp` of all directions.
      geom1: first geom. A NumPy array (static) if every candidate has its own slots; traced if
        contacts are selected at run time.
      geom2: second geom, static or traced like `geom1`.
      pair: explicit <pair> of the contact, -1 for none; static or traced like `geom1`.
      overflow: upper bound on the number of contacts lost because of the limits on pairs and slots;
        0 means that no contact was lost.
      ranges: ranges of slots, one after the other, each of one kind.
      adhesion: force by which the surfaces pull each other (N); None if the model has no adhesion.
      gap: distance beyond the margin across which they do (m), zero without adhesion; or None.
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
    adhesion: Float[Array, "nc"] | None = None
    gap: Float[Array, "nc"] | None = None

    @property
    def active(self) -> Bool[Array, "nc"]:
        """Whether each slot may have force: its distance is below the margin.

        The gap counts only for adhesion.
        """
        reach = self.includemargin
        return self.dist < (reach if self.gap is None else reach + self.gap)

    @property
    def condim(self) -> np.ndarray:
        """Dimension of each slot (static)."""
        return np.repeat([r.condim for r in self.ranges], [r.stop - r.start for r in self.ranges])
