"""Sums of zero-padded arrays, computed as one concatenation.

In reverse mode, the cotangent of each slice of an array is padded with zeros to the shape of the
array, and all of these are added. Here the parts are collected lazily, and the sum is written once,
as a concatenation of regions.
"""

import dataclasses
import functools
import itertools

import jax.numpy as jnp
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.batching.lazy import Lazy

Box = tuple[tuple[int, int], ...]  # begin and end along each axis


@dataclasses.dataclass(frozen=True)
class PaddedSum(Lazy):
    """The sum of arrays, each placed in an array of zeros.

    Attributes:
      shape: shape of the sum.
      parts: the arrays and their positions.
    """

    shape: tuple[int, ...]
    parts: tuple[tuple[tuple[int, ...], jnp.ndarray], ...]

    def plus(self, other) -> "PaddedSum":
        """The sum with the parts of another such sum, or with an array."""
        parts = other.parts if isinstance(other, PaddedSum) else (((0,) * other.ndim, other),)
        return PaddedSum(self.shape, self.parts + parts)

    def force(self):
        """The sum as an array."""
        whole = tuple((0, size) for size in self.shape)
        parts = [(_box(start, x.shape), x) for start, x in self.parts]
        if _cells(parts, whole, 0) > tuning.PADDED_REGIONS:
            return functools.reduce(lax.add, (_padded(box, x, self.shape) for box, x in parts))
        return _fill(parts, whole, 0)


def _fill(parts, region: Box, axis: int):
    """The sum within a region, which is divided along this axis and later ones."""
    if axis == len(region):
        return functools.reduce(lax.add, (_cut(box, x, region) for box, x in parts))
    rows = []
    for inner in _divide(parts, region, axis):
        inside = _inside(parts, inner, axis)
        rows.append(_fill(inside, inner, axis + 1) if inside else _zeros(parts, inner))
    return rows[0] if len(rows) == 1 else lax.concatenate(rows, axis)


def _cells(parts, region: Box, axis: int) -> int:
    """Number of regions that `_fill` writes."""
    if not parts or axis == len(region):
        return 1
    inner = _divide(parts, region, axis)
    return sum(_cells(_inside(parts, box, axis), box, axis + 1) for box in inner)


def _divide(parts, region: Box, axis: int) -> list[Box]:
    """The region divided along an axis at the ends of all parts."""
    low, high = region[axis]
    edges = {low, high}.union(*(box[axis] for box, _ in parts))
    cuts = itertools.pairwise(sorted(e for e in edges if low <= e <= high))
    return [(*region[:axis], cut, *region[axis + 1 :]) for cut in cuts]


def _inside(parts, region: Box, axis: int) -> list:
    """The parts that overlap the region along an axis."""
    low, high = region[axis]
    return [(box, x) for box, x in parts if box[axis][0] < high and box[axis][1] > low]


def _cut(box: Box, x, region: Box):
    start = [r[0] - b[0] for r, b in zip(region, box, strict=True)]
    return lax.slice(x, start, [s + r[1] - r[0] for s, r in zip(start, region, strict=True)])


def _zeros(parts, region: Box):
    return jnp.zeros([high - low for low, high in region], parts[0][1].dtype)


def _padded(box: Box, x, shape: tuple[int, ...]):
    config = [(low, size - high, 0) for (low, high), size in zip(box, shape, strict=True)]
    return lax.pad(x, jnp.zeros((), x.dtype), config)


def _box(start: tuple[int, ...], shape: tuple[int, ...]) -> Box:
    return tuple((s, s + n) for s, n in zip(start, shape, strict=True))
