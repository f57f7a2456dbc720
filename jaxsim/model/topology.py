"""Forests in breadth-first order, over which the recursions of the dynamics run.

A `Forest` stores parents, kinds and numbers of degrees of freedom. Nodes are renumbered so that a
depth level is a contiguous slice, and within a level the nodes of one kind are contiguous, too.
A recursion can therefore slice its arrays and needs no gathers.
"""

import dataclasses
import functools

import numpy as np

from jaxsim.arrays import tuning


@dataclasses.dataclass(frozen=True)
class NodeGroup:
    """Nodes of one level and one kind; `nodes` and `dofs` are slices within the level."""

    kind: int
    nodes: slice
    dofs: slice
    ndof: int


@dataclasses.dataclass(frozen=True, eq=False)
class Level:
    """All nodes of one depth.

    Attributes:
      nodes: slice of the level in the order of nodes.
      dofs: slice of the level in the order of degrees of freedom.
      parents: index of each node's parent within the previous level; a root's own index.
      groups: the nodes by kind.
    """

    nodes: slice
    dofs: slice
    parents: np.ndarray
    groups: tuple[NodeGroup, ...]

    @property
    def size(self) -> int:
        """Number of nodes in the level."""
        return self.nodes.stop - self.nodes.start

    @property
    def ndof(self) -> int:
        """Number of degrees of freedom in the level."""
        return self.dofs.stop - self.dofs.start

    def repeats(self, other: "Level") -> bool:
        """Whether a scan can run both levels with one body."""
        return self.groups == other.groups and np.array_equal(self.parents, other.parents)


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """Consecutive levels `start:stop`; if there are several, they are all equal."""

    start: int
    stop: int


class Forest:
    """Trees in breadth-first order.

    Attributes:
      order: (n,) original index of each node.
      position: (n,) node at each original index, the inverse permutation.
      parent: (n,) parent node; -1 for a root.
      root: (n,) index of the node's tree, that is of its root in the first level.
      ndof: (n,) degrees of freedom of each node.
      dof_node: (nv,) node of each degree of freedom.
      levels: the levels, roots first.
      runs: the levels, grouped into runs for `lax.scan`.
    """

    def __init__(self, parent, kind=None, ndof=None):
        """Order a forest.

        Args:
          parent: (n,) original index of the parent, negative for a root.
          kind: (n,) small integers; nodes of one kind in one level are processed together.
          ndof: (n,) degrees of freedom, equal for equal kinds.
        """
        parent = np.asarray(parent, int)
        n = len(parent)
        kind = np.zeros(n, int) if kind is None else np.asarray(kind, int)
        ndof = np.zeros(n, int) if ndof is None else np.asarray(ndof, int)
        depth = np.zeros(n, int)
        for i in _parents_first(parent):
            depth[i] = depth[parent[i]] + 1 if parent[i] >= 0 else 0
        self.order = _breadth_first(parent, kind, depth)
        self.position = np.empty(n, int)
        self.position[self.order] = np.arange(n)
        sorted_parent = parent[self.order]
        self.parent = np.where(sorted_parent >= 0, self.position[sorted_parent], -1).astype(int)
        self.kind = kind[self.order]
        self.ndof = ndof[self.order]
        self.dof_start = np.concatenate([[0], np.cumsum(self.ndof)])[:n].astype(int)
        self.dof_node = np.repeat(np.arange(n), self.ndof)
        self.levels = self._levels(depth[self.order])
        self.runs = _runs(self.levels)
        self.root = np.zeros(n, int)
        for i in range(n):
            self.root[i] = i if self.parent[i] < 0 else self.root[self.parent[i]]

    def __len__(self) -> int:
        return len(self.order)

    @property
    def nroot(self) -> int:
        """Number of trees."""
        return self.levels[0].size if self.levels else 0

    @property
    def nv(self) -> int:
        """Total number of degrees of freedom."""
        return len(self.dof_node)

    def _levels(self, depth: np.ndarray) -> tuple[Level, ...]:
        levels = []
        for d in range(depth.max(initial=-1) + 1):
            (ids,) = np.nonzero(depth == d)
            lo, hi = ids[0], ids[-1] + 1
            dof_lo = self.dof_start[lo]
            dof_hi = dof_lo + self.ndof[lo:hi].sum()
            # The recursion supplies one parent value for each root.
            parents = np.arange(hi - lo)
            if levels:
                parents = self.parent[lo:hi] - levels[-1].nodes.start
            groups, at, dof_at = [], 0, 0
            for k in sorted(set(self.kind[lo:hi])):
                count = int((self.kind[lo:hi] == k).sum())
                nd = int(self.ndof[lo + at])
                groups.append(
                    NodeGroup(int(k), slice(at, at + count), slice(dof_at, dof_at + count * nd), nd)
                )
                at, dof_at = at + count, dof_at + count * nd
            levels.append(
                Level(
                    slice(int(lo), int(hi)), slice(int(dof_lo), int(dof_hi)), parents, tuple(groups)
                )
            )
        return tuple(levels)

    @functools.cached_property
    def ancestor(self) -> np.ndarray:
        """(n, n) bool: [i, j] says whether j is i or an ancestor of i."""
        result = np.eye(len(self), dtype=bool)
        for i in range(len(self)):
            if self.parent[i] >= 0:
                result[i] |= result[self.parent[i]]
        return result

    @functools.cached_property
    def moves(self) -> np.ndarray:
        """(n + 1, nv) bool: [i, k] says whether dof k moves node i; the last row is the world's."""
        rows = self.ancestor[:, self.dof_node]
        return np.concatenate([rows, np.zeros((1, self.nv), bool)])


def _parents_first(parent: np.ndarray) -> list[int]:
    """Indices sorted so that parents precede their children, for any numbering."""
    children: dict[int, list[int]] = {}
    for i, p in enumerate(parent):
        children.setdefault(max(int(p), -1), []).append(i)
    result, front = [], children.get(-1, [])
    while front:
        result += front
        front = [c for i in front for c in children.get(i, [])]
    return result


def _breadth_first(parent: np.ndarray, kind: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Order by depth, then kind, then the parent's position, then the original index."""
    order: list[int] = []
    position = np.zeros(len(parent), int)
    for d in range(depth.max(initial=-1) + 1):
        ids = np.nonzero(depth == d)[0].tolist()
        ids.sort(key=lambda i: (kind[i], position[parent[i]] if parent[i] >= 0 else 0, i))
        position[ids] = np.arange(len(order), len(order) + len(ids))
        order += ids
    return np.asarray(order, int)


def _runs(levels: tuple[Level, ...]) -> tuple[Run, ...]:
    """Group equal consecutive levels into runs if these are long enough for a scan."""
    runs: list[Run] = []
    start = 0
    while start < len(levels):
        stop = start + 1
        # The carry of a scan is the previous level, which must therefore have the same width. For
        # the first level the recursion supplies one value for each root.
        if start == 0 or levels[start - 1].size == levels[start].size:
            while stop < len(levels) and levels[stop].repeats(levels[start]):
                stop += 1
        if stop - start < tuning.SCANNED_LEVELS:
            stop = start + 1
        runs.append(Run(start, stop))
        start = stop
    return tuple(runs)
