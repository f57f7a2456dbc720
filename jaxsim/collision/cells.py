"""Cells of directions, and which corners of a hull can be the furthest in each of them.

The directions through a face of a cube are divided into SIDE x SIDE cells. The directions of a cell
are sums, with weights that are not negative, of those to its four corners. So if one corner of a
hull is further than another along these four, it is so along all directions of the cell.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

SIDE = 16
CELLS = 6 * SIDE**2
# Hulls with at most FEW corners need no cells.
FEW = 16
# Rounding errors of heights, relative to the largest.
SLACK = 1e-6


def cell_of(d: Float[Array, "3"]) -> Int[Array, ""]:
    """The number of the cell that contains a direction, which need not be a unit vector."""
    d = lax.stop_gradient(d)
    x, y, z = jnp.abs(d)
    axis = jnp.where((x >= y) & (x >= z), 0, jnp.where(y >= z, 1, 2))
    first, second, third = (d[(axis + k) % 3] for k in range(3))
    scale = SIDE / 2 / jnp.where(first == 0, 1, jnp.abs(first))
    row, column = (
        jnp.clip((SIDE / 2 + scale * v).astype(jnp.int32), 0, SIDE - 1) for v in (second, third)
    )
    face = 2 * axis + (first > 0)
    return (face * SIDE + row) * SIDE + column


def furthest_corners(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the corners that may be the furthest in each cell, ascending.

    Args:
      corners: (v, 3) corners of a hull.

    Returns:
      (CELLS, 2) where the numbers of each cell start in the list of all, and how many they are;
      and that list. A hull of at most FEW corners has them all in every cell.
    """
    everything = np.arange(len(corners))
    if len(corners) <= FEW:
        return np.tile([0, len(corners)], (CELLS, 1)), everything
    numbers, count, side = np.tile(everything, 6), np.full(6, len(corners)), 1
    while True:
        borders = np.repeat(_borders(side), count, axis=0)
        kept = _not_behind(np.einsum("nk,njk->jn", corners[numbers], borders), count)
        count = np.add.reduceat(kept, np.cumsum(count) - count, dtype=int)
        numbers, start = numbers[kept], np.cumsum(count) - count
        if side == SIDE:
            return np.stack([start, count], axis=1), numbers
        # Each cell has four parts, which start with its corners.
        whole = np.arange(len(count)).reshape(6, side, side).repeat(2, axis=1).repeat(2, axis=2)
        start, count, side = start[whole.ravel()], count[whole.ravel()], 2 * side
        numbers = numbers[
            np.repeat(start - (np.cumsum(count) - count), count) + np.arange(count.sum())
        ]


@functools.cache
def _borders(side: int) -> np.ndarray:
    """(6 * side**2, 4, 3) directions to the corners of cells, in the order of their numbers."""
    ticks = np.linspace(-1, 1, side + 1)
    faces = []
    for axis in range(3):
        for sign in (-1, 1):
            grid = np.zeros((side + 1, side + 1, 3))
            grid[..., axis] = sign
            grid[..., (axis + 1) % 3] = ticks[:, None]
            grid[..., (axis + 2) % 3] = ticks[None]
            four = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
            faces.append(np.stack(four, axis=2).reshape(-1, 4, 3))
    return np.concatenate(faces)


def _not_behind(height: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Which columns of heights are not below one of some of the same cell in all rows.

    Args:
      height: (4, n) heights of the corners of the first cell, then of the second, and so on.
      count: (cells,) number of corners of each cell, at least one.
    """
    start = np.cumsum(count) - count
    cell = np.repeat(np.arange(len(count)), count)
    slack = SLACK * np.maximum.reduceat(np.abs(height).max(axis=0), start)
    behind = np.zeros(len(cell), bool)
    for measure in (*height, height.sum(axis=0)):
        (highest,) = np.nonzero(measure == np.maximum.reduceat(measure, start)[cell])
        first = np.append(True, np.diff(cell[highest]) > 0)
        best = height[:, highest[first]] - slack
        behind |= (height < best[:, cell]).all(axis=0)
    return ~behind
