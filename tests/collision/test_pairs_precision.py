"""Every pair function in float32 near touching, against float64."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit
from pair_sizes import SIZES

import jaxsim
from jaxsim.collision import PAIRS, Shape
from jaxsim.collision.table import type_name

NAMES = [(type_name(a), type_name(b)) for a, b in PAIRS]
TILTS = [0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3]
AXES = [[0, 0, 1], [1, 0, 0], [0, 0.6, 0.8]]


@functools.cache
def evaluate(names):
    key = next(k for k in PAIRS if tuple(map(type_name, k)) == names)

    def f(pos, mat, size):
        shapes = [Shape(pos[i], mat[i], size[i]) for i in range(2)]
        contacts = PAIRS[key].function(*shapes)
        return contacts.dist, contacts.normal

    return quick_jit(jaxsim.vmap(f, in_axes=(0, 0, None)))


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


@pytest.mark.parametrize("names", NAMES, ids="-".join)
def test_float32_agrees_near_touching(names, rng):
    """The two are moved along their normal until they touch; numbers are rounded first."""
    size = np.zeros((2, 3))
    for row, name in zip(size, names, strict=True):
        numbers = np.array(SIZES[name].split(), float)
        row[: len(numbers)] = numbers
    pos, mat = almost_aligned(rng)
    f = evaluate(names)
    for _ in range(2):
        dist, normal = jax.device_get(f(pos, mat, size))
        deepest = np.argmin(dist, axis=1)[:, None]
        normal = np.broadcast_to(normal, (*dist.shape, 3))
        normal = np.take_along_axis(normal, deepest[..., None], axis=1)[:, 0]
        pos[:, 1] -= np.take_along_axis(dist, deepest, axis=1) * normal
    single = [x.astype(np.float32) for x in (pos, mat, size)]
    double = [x.astype(np.float64) for x in single]
    dist = np.min(f(*double)[0], axis=1)
    assert np.abs(dist).max() < 2e-3
    # The float32 sum of a position and a size is rounded to 3e-8 m, and a dozen of them are added.
    np.testing.assert_allclose(np.min(f(*single)[0], axis=1), dist, atol=5e-7)
    assert f(*map(jnp.asarray, single))[0].dtype == jnp.float32
