"""Every pair function in float32 near touching, against float64."""

import jax
import numpy as np
import pytest
from pair_sizes import ALL, hulls, rounded, values

TILTS = [0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3]
AXES = [[0, 0, 1], [1, 0, 0], [0, 0.6, 0.8]]


def rotation(axis, angle):
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def almost_aligned(rng):
    """(n, 2, 3), (n, 2, 3, 3): shapes side by side, parallel or at right angles up to a tilt."""
    rows = []
    for tilt in TILTS:
        for turn in (0, np.pi / 4, np.pi / 2):
            for axis in AXES:
                common = rotation(rng.normal(size=3), rng.uniform(0, 3))
                mat = rotation(rng.normal(size=3), tilt) @ rotation(axis, turn)
                offset = np.array([*rng.uniform(-0.03, 0.03, 2), 0.25])
                rows.append(([np.zeros(3), common @ offset], [common, common @ mat]))
    pos, mat = (np.array(x) for x in zip(*rows, strict=True))
    return pos, mat


@pytest.mark.parametrize("names", ALL, ids="-".join)
def test_float32_agrees_near_touching(names, rng, two_geoms):
    """The two are moved along their normal until they touch; numbers are rounded first."""
    model = two_geoms(*names)
    size, hull, f = model.geom_size, hulls(model), values(names)
    pos, mat = almost_aligned(rng)
    for _ in range(2):
        dist, _, normal = jax.device_get(f(pos, mat, size, hull))
        deepest = np.argmin(dist, axis=1)[:, None]
        normal = np.take_along_axis(normal, deepest[..., None], axis=1)[:, 0]
        pos[:, 1] -= np.take_along_axis(dist, deepest, axis=1) * normal
    single = rounded((pos, mat, size, hull), np.float32)
    dist = np.min(f(*rounded(single, np.float64))[0], axis=1)
    assert np.abs(dist).max() < 2e-3
    # The float32 sum of a position and a size is rounded to 3e-8 m, and a dozen of them are added.
    np.testing.assert_allclose(np.min(f(*single)[0], axis=1), dist, atol=5e-7)
    assert f(*single)[0].dtype == np.float32


def test_points_of_a_small_sphere_on_a_mesh_agree_in_float32(rng, two_geoms):
    """On faces, too, where every corner of the face is as near along the normal."""
    names = "sphere", "mesh"
    model = two_geoms(*names)
    size, hull, f = 0.05 * model.geom_size, hulls(model), values(names)
    size[1] = model.geom_size[1]
    pos = np.stack([rng.uniform(-0.12, 0.12, (54, 3)), np.zeros((54, 3))], axis=1)
    single = rounded((pos, np.tile(np.eye(3), (54, 2, 1, 1)), size, hull), np.float32)
    dist, points, _ = f(*rounded(single, np.float64))
    outside = np.asarray(dist[:, 0]) > -size[0, 0]
    assert outside.sum() > 30
    np.testing.assert_allclose(f(*single)[1][outside], points[outside], atol=1e-6)
