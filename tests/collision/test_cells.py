"""Corners of hulls are found by direction: they are the furthest of all corners."""

import jax
import numpy as np

from jaxsim.collision.cells import CELLS, FEW, cell_of, furthest_corners


def can(corners, radius=0.4):
    """Corners of a prism that is almost a cylinder: many corners on each of two faces."""
    angle = 2 * np.pi * np.arange(corners) / corners
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([np.insert(ring, 2, z, axis=1) for z in (-0.3, 0.5)])


def directions(rng):
    """Random directions, and some on the borders of cells."""
    some = rng.normal(size=(3000, 3))
    some[:1000] *= rng.integers(-1, 2, (1000, 3))
    some[1000:1500] = np.sign(some[1000:1500]) * [1, 0.25, 0.5]
    return some[np.abs(some).sum(axis=1) > 0].astype(np.float32)


def test_a_cell_has_the_furthest_corner_of_each_of_its_directions(rng):
    ball = rng.normal(size=(400, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    along = directions(rng)
    cells = np.asarray(jax.jit(jax.vmap(cell_of))(along))
    assert cells.min() >= 0
    assert cells.max() < CELLS
    for corners, usual in ((ball, 10), (can(60), 10)):
        places, numbers = furthest_corners(corners)
        height = along @ corners.T
        for d, (start, count) in zip(height, places[cells], strict=True):
            assert d[numbers[start : start + count]].max() == d.max()
        assert np.median(places[:, 1]) < usual


def test_small_hulls_have_all_corners_in_every_cell():
    places, numbers = furthest_corners(can(FEW // 2))
    np.testing.assert_array_equal(numbers, np.arange(FEW))
    np.testing.assert_array_equal(places, np.tile([0, FEW], (CELLS, 1)))
