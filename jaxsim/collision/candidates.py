"""Candidate pairs: the geom pairs that may collide, by MuJoCo's static filters.

The filters are those of MuJoCo 3.17 (chapter "Computation", section "Collision detection"). Dynamic
pairs must match by `contype` and `conaffinity`, must be able to move relative to each other, must
not belong to a body and its parent, and must not be excluded. Explicit `<pair>`s only must be able
to move relative to each other. All of this is static, in NumPy on the host.
"""

import dataclasses
import itertools
from typing import Any

import mujoco
import numpy as np

from jaxsim.collision.contact import ContactKind, SlotRange
from jaxsim.collision.table import PAIRS
from jaxsim.collision.unsupported import is_supported, unsupported_pairs
from jaxsim.model.errors import ModelError
from jaxsim.model.facts import fact
from jaxsim.model.names import Names
from jaxsim.model.problems import raise_problems

# One upper limit for all groups (or kinds), one for each of them, or none.
Limit = int | tuple[int, ...] | None


@dataclasses.dataclass(frozen=True, eq=False)
class PairGroup:
    """Candidate pairs with the same pair function and kind of contact; arrays are (n,), static.

    Attributes:
      types: the two types of geom, the lower number first.
      kind: the kind of their contacts.
      geom1: first geom of each pair.
      geom2: second geom of each pair.
      pair: index of the explicit <pair>, -1 for dynamic pairs.
    """

    types: tuple[int, int]
    kind: ContactKind
    geom1: np.ndarray
    geom2: np.ndarray
    pair: np.ndarray

    @property
    def slots_per_pair(self) -> int:
        """Number of contact slots of each pair."""
        return PAIRS[self.types].max_contacts

    def __len__(self) -> int:
        return len(self.geom1)


@dataclasses.dataclass(frozen=True, eq=False)
class Candidates:
    """The candidate pairs of a model, and limits on the pairs evaluated and the contacts kept.

    Attributes:
      groups: groups of pairs, ordered by kind, then by types.
      max_geom_pairs: most pairs whose contacts are computed at a time step, for each group or as
        one number for every group; None for all.
      max_contacts: number of contact slots, for each kind of contact or as one number for every
        kind; None for all possible contacts.
    """

    groups: tuple[PairGroup, ...]
    max_geom_pairs: Limit = None
    max_contacts: Limit = None

    @property
    def dynamic(self) -> bool:
        """Whether pairs or contacts are selected at run time, because the limits are exceeded."""
        return self.pairs() != [len(g) for g in self.groups] or self.slots() != self._available()

    @property
    def ranges(self) -> tuple[SlotRange, ...]:
        """The ranges of contact slots, one for each kind."""
        stops = np.cumsum(self.slots(), dtype=int).tolist()
        ranges = zip([0, *stops], stops, self.by_kind(), strict=False)
        return tuple(SlotRange(start, stop, kind) for start, stop, kind in ranges)

    @property
    def ncon(self) -> int:
        """Number of contact slots."""
        return sum(self.slots())

    def by_kind(self) -> dict[ContactKind, list[PairGroup]]:
        """The groups of each kind, in order."""
        runs = itertools.groupby(self.groups, key=lambda g: g.kind)
        return {kind: list(groups) for kind, groups in runs}

    def pairs(self) -> list[int]:
        """Number of pairs of each group whose contacts are computed."""
        return _within(self.max_geom_pairs, [len(g) for g in self.groups])

    def slots(self) -> list[int]:
        """Number of contact slots of each kind."""
        return _within(self.max_contacts, self._available())

    def _available(self) -> list[int]:
        """Largest number of contacts of each kind that the evaluated pairs can have."""
        total: dict[ContactKind, int] = {}
        for group, pairs in zip(self.groups, self.pairs(), strict=True):
            total[group.kind] = total.get(group.kind, 0) + pairs * group.slots_per_pair
        return list(total.values())


def _within(limits: Limit, sizes: list[int]) -> list[int]:
    """The sizes, each reduced to its limit."""
    if limits is None:
        return sizes
    limits = limits if isinstance(limits, tuple) else (limits,) * len(sizes)
    return [min(pair) for pair in zip(sizes, limits, strict=True)]


def find_candidates(
    model: Any,
    max_geom_pairs: Limit = None,
    max_contacts: Limit = None,
) -> Candidates:
    """All geom pairs of a model that may have contact forces.

    Args:
      model: a `Model`, a `mujoco.MjModel`, or anything with their fields.
      max_geom_pairs: see `Candidates`.
      max_contacts: see `Candidates`.

    Returns:
      The pairs in a deterministic order.

    Raises:
      ModelError: a pair of geoms may collide but has no pair function, or a limit is not positive.
    """
    for name, limit in (("max_geom_pairs", max_geom_pairs), ("max_contacts", max_contacts)):
        if limit is not None and np.min(limit, initial=1) < 1:
            raise ModelError(f"{name} must be a positive number or None, got {limit}")
    return Candidates(pair_groups(model), max_geom_pairs, max_contacts)


def model_candidates(model: Any) -> Candidates:
    """The candidates of a `Model`, with the model's own limits."""
    return find_candidates(model, model.max_geom_pairs, model.max_contacts)


@fact()
def pair_groups(model: Any) -> tuple[PairGroup, ...]:
    """All candidate pairs, ordered by kind, then by types, then by geoms.

    Pairs without a pair function raise a `ModelError`, or are left out if the model was loaded with
    `unsupported_pairs="drop"`.
    """
    rows = candidate_pairs(model)
    if getattr(model, "drops_pairs", False):
        return _grouped(model, rows[is_supported(model, rows)])
    names = Names.from_mujoco(model) if isinstance(model, mujoco.MjModel) else model.names
    raise_problems(unsupported_pairs(model, rows, names.label))
    return _grouped(model, rows)


def candidate_pairs(model: Any) -> np.ndarray:
    """The pairs that pass MuJoCo's static filters, with or without a pair function.

    Returns:
      (n, 3) rows of first geom, second geom (of higher or equal type) and explicit pair, or -1.
    """
    flags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    if int(model.opt.disableflags) & flags:
        return np.zeros((0, 3), int)
    rows = np.concatenate([_explicit_pairs(model), _dynamic_pairs(model)])
    return _ordered_by_type(model, rows)


def _explicit_pairs(model: Any) -> np.ndarray:
    """Rows (geom1, geom2, pair) of explicit pairs whose geoms can move relative to each other."""
    rows = np.stack(
        [np.asarray(model.pair_geom1), np.asarray(model.pair_geom2), np.arange(model.npair)], axis=1
    ).astype(int)
    return rows[_can_move(model, rows[:, 0], rows[:, 1])]


def _dynamic_pairs(model: Any) -> np.ndarray:
    """Rows (geom1, geom2, -1) of pairs that pass every filter and are not explicit."""
    geom1, geom2 = np.triu_indices(model.ngeom, k=1)
    keep = _can_move(model, geom1, geom2)
    keep &= _masks_match(model, geom1, geom2)
    keep &= ~_parent_and_child(model, geom1, geom2)
    keep &= ~_excluded(model, geom1, geom2)
    keep &= ~_explicit(model, geom1, geom2)
    rows = np.stack([geom1, geom2, np.full_like(geom1, -1)], axis=1)
    return rows[keep]


def _weld(model: Any, geom: np.ndarray) -> np.ndarray:
    """Topmost body to which each geom's body is welded; 0 is the world."""
    return np.asarray(model.body_weldid)[np.asarray(model.geom_bodyid)[geom]]


def _can_move(model: Any, geom1: np.ndarray, geom2: np.ndarray) -> np.ndarray:
    """Whether geoms can move relative to each other: not welded together and not both fixed."""
    apart = _weld(model, geom1) != _weld(model, geom2)
    return apart & (is_movable(model, geom1) | is_movable(model, geom2))


def is_movable(model: Any, geom: np.ndarray) -> np.ndarray:
    """Whether geoms are moved by joints; those of the world and of mocap bodies are not."""
    return np.asarray(model.body_dofnum)[_weld(model, geom)] > 0


def _masks_match(model: Any, geom1: np.ndarray, geom2: np.ndarray) -> np.ndarray:
    contype, conaffinity = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    return ((contype[geom1] & conaffinity[geom2]) | (contype[geom2] & conaffinity[geom1])) != 0


def _parent_and_child(model: Any, geom1: np.ndarray, geom2: np.ndarray) -> np.ndarray:
    """Whether one body is the other's parent, up to welds; the world does not count as a parent."""
    if int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        return np.zeros(geom1.shape, bool)
    weld1, weld2 = _weld(model, geom1), _weld(model, geom2)
    weld_parent = np.asarray(model.body_weldid)[np.asarray(model.body_parentid)]
    related = (weld1 == weld_parent[weld2]) | (weld2 == weld_parent[weld1])
    return related & (weld1 != 0) & (weld2 != 0)


def _excluded(model: Any, geom1: np.ndarray, geom2: np.ndarray) -> np.ndarray:
    bodies = np.sort(np.asarray(model.geom_bodyid)[np.stack([geom1, geom2])], axis=0).astype(int)
    return np.isin((bodies[0] << 16) + bodies[1], np.asarray(model.exclude_signature))


def _explicit(model: Any, geom1: np.ndarray, geom2: np.ndarray) -> np.ndarray:
    ends = np.sort(np.stack([model.pair_geom1, model.pair_geom2]).astype(int), axis=0)
    return np.isin(geom1 * model.ngeom + geom2, ends[0] * model.ngeom + ends[1])


def _ordered_by_type(model: Any, rows: np.ndarray) -> np.ndarray:
    """Swap the geoms of a pair where needed, so that the lower type comes first."""
    types = np.asarray(model.geom_type)[rows[:, :2]]
    return np.where((types[:, 0] > types[:, 1])[:, None], rows[:, [1, 0, 2]], rows)


def _condim(model: Any, rows: np.ndarray) -> np.ndarray:
    """Condim of the explicit pair, of the geom of higher priority, or the larger of both geoms."""
    geom1, geom2, pair = rows.T
    condim, priority = np.asarray(model.geom_condim), np.asarray(model.geom_priority)
    largest = np.maximum(condim[geom1], condim[geom2])
    result = np.where(priority[geom1] > priority[geom2], condim[geom1], largest)
    result = np.where(priority[geom1] < priority[geom2], condim[geom2], result)
    result[pair >= 0] = np.asarray(model.pair_dim)[pair[pair >= 0]]
    return result


def _grouped(model: Any, rows: np.ndarray) -> tuple[PairGroup, ...]:
    movable = is_movable(model, rows[:, :2])
    types = np.asarray(model.geom_type)[rows[:, :2]]
    keys = np.concatenate([_condim(model, rows)[:, None], movable, types], axis=1).astype(int)
    order = np.lexsort(np.concatenate([keys, rows], axis=1).T[::-1])
    starts = np.nonzero(np.diff(keys[order], axis=0, prepend=-1).any(axis=1))[0]
    return tuple(_group(keys[run[0]], rows[run]) for run in np.split(order, starts)[1:])


def _group(key: np.ndarray, rows: np.ndarray) -> PairGroup:
    condim, movable1, movable2, *types = key.tolist()
    kind = ContactKind(condim, (bool(movable1), bool(movable2)))
    return PairGroup(tuple(types), kind, *rows.T)
