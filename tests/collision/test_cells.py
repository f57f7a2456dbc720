"""Corners of hulls are found by direction: they are the furthest of all corners."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.collision.cells import CELLS, FEW, cell_of, furthest_corners
from jaxsim.collision.convex import Polytope
from jaxsim.collision.hulls import Hulls
from jaxsim.collision.shapes import Shape
from jaxsim.io.hulls import hull_tables


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


def test_support_points_are_those_of_all_corners(rng):
    """Of a mesh with many corners on a flat face, of any scale."""
    ball = rng.normal(size=(512, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    ball[:, 2] = np.minimum(ball[:, 2], 0.8)
    vertex = " ".join(f"{x:.6f}" for x in ball.ravel())
    mj = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="dome" vertex="{vertex}" scale="1 .3 .5"/></asset><worldbody>
        <geom type="mesh" mesh="dome"/></worldbody></mujoco>"""
    )
    with pytest.warns(UserWarning, match="maxhullvert"):
        tables = SimpleNamespace(**hull_tables(mj, lambda kind, i: kind))
    hulls = Hulls(tables, np.array([0]), float)
    assert hulls.near is not None

    def support(d, near):
        size = jnp.asarray(mj.geom_size[0], d.dtype)
        shape = hulls.complete(Shape(jnp.zeros(3), jnp.eye(3), size), jnp.zeros((), jnp.int32))
        return Polytope(shape.replace(hull=shape.hull.replace(near=near))).support(d)

    d = directions(rng)
    found, number = jax.jit(jaxsim.vmap(lambda d: support(d, hulls.near)))(d)
    furthest, right = jax.jit(jaxsim.vmap(lambda d: support(d, None)))(d)
    np.testing.assert_array_equal(number, right)
    np.testing.assert_array_equal(found, furthest)
