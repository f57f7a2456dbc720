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
FEW = 64
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
    found, side = [everything] * 6, 1
    while True:
        borders = _borders(side)
        found = [n[_not_behind(corners[n] @ b.T)] for n, b in zip(found, borders, strict=True)]
        if side == SIDE:
            break
        quarters = np.arange(len(found)).reshape(6, side, side).repeat(2, axis=1).repeat(2, axis=2)
        found, side = [found[k] for k in quarters.ravel()], 2 * side
    count = np.array([len(n) for n in found])
    return np.stack([np.cumsum(count) - count, count], axis=1), np.concatenate(found)


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


def _not_behind(height: np.ndarray) -> np.ndarray:
    """Rows of (v, 4) heights that are not below one of some rows in all columns."""
    best = height[np.append(height.argmax(axis=0), height.sum(axis=1).argmax())]
    slack = SLACK * np.abs(height).max()
    behind = (height[:, None] < best[None] - slack).all(axis=2).any(axis=1)
    return np.flatnonzero(~behind)
