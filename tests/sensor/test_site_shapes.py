"""Volumes of sites: points inside and rays that hit, against definitions and MuJoCo."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxsim.sensor.shapes import inside, ray_hits

SHAPES = [
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{n}"))
    for n in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
]
SIZE = np.array([0.3, 0.5, 0.2])


@pytest.mark.parametrize("shape", SHAPES)
def test_rays_hit_as_in_mujoco(shape, rng, x64):
    starts = rng.uniform(-1, 1, (400, 3))
    targets = rng.uniform(-0.8, 0.8, (400, 3))
    directions = targets - starts
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # Rays along the axes have vanishing components.
    directions[:60] = np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (10, 1))
    hits = jax.vmap(lambda p, d: ray_hits(shape, jnp.asarray(SIZE), p, d))(starts, directions)
    expected = [
        mujoco.mju_rayGeom(np.zeros(3), np.eye(3).ravel(), SIZE, p, d, shape, None) >= 0
        for p, d in zip(starts, directions, strict=True)
    ]
    np.testing.assert_array_equal(hits, expected)
    assert 0.1 < np.mean(expected) < 0.9


@pytest.mark.parametrize("shape", SHAPES)
def test_a_point_is_inside_if_all_rays_from_it_hit(shape, rng):
    points = rng.uniform(-0.6, 0.6, (300, 3)).astype(np.float32)
    size = jnp.asarray(SIZE, jnp.float32)
    within = jax.vmap(lambda p: inside(shape, size, p))(points)
    all_hit = np.ones(len(points), bool)
    for direction in np.float32(np.concatenate([np.eye(3), -np.eye(3)])):
        all_hit &= np.asarray(jax.vmap(lambda p, d=direction: ray_hits(shape, size, p, d))(points))
    np.testing.assert_array_equal(within, all_hit)
    assert within.any()
