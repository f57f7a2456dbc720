"""Flat contacts have as many points as MuJoCo's, and support as well."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from pair_sizes import entry, hulls, values

from jaxsim.collision import Shape

CASES = [("capsule", "cylinder"), ("cylinder", "cylinder"), ("cylinder", "box")]
DEPTH = 0.002


def turned(axis, angle):
    quat, mat = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quat, np.asarray(axis, float), angle)
    mujoco.mju_quat2Mat(mat, quat)
    return mat.reshape(3, 3)


def laid_on_each_other(rng, tilt, count=12):
    """Rotations of both, and the direction in which the second lies on the first."""
    sides = [turned([1, 0, 0], k * np.pi / 2) for k in range(4)]
    sides += [turned([0, 1, 0], k * np.pi / 2) for k in (1, 3)]
    rows = []
    for _ in range(count):
        axis = rng.normal(size=3)
        common = turned(axis / np.linalg.norm(axis), rng.uniform(0, 3))
        heading = rng.uniform(0, 2 * np.pi)
        leaning = turned([np.cos(heading), np.sin(heading), 0], tilt)
        spin = turned([0, 0, 1], rng.uniform(0, 6))
        first, second = (sides[k] for k in rng.integers(6, size=2))
        rows.append(([common @ first, common @ leaning @ spin @ second], common[:, 2]))
    return tuple(np.array(x) for x in zip(*rows, strict=True))


def pressed(names, mat, up, size, hull, rng):
    """Positions at which the second is as deep in the first as `DEPTH` along that direction."""
    pos = np.zeros((len(mat), 2, 3))
    pos[:, 1] = 0.5 * up + rng.uniform(-0.02, 0.02, pos[:, 1].shape)
    for _ in range(8):
        dist = np.asarray(values(names)(pos, mat, size, hull)[0]).min(axis=1)
        pos[:, 1] -= np.clip(dist + DEPTH, -0.05, 1)[:, None] * up
    return pos


@pytest.mark.parametrize("tilt", [0, 1e-6, 0.02])
@pytest.mark.parametrize("names", CASES, ids="-".join)
def test_number_and_depth_are_mujocos(names, tilt, rng, two_geoms, contacts_of):
    model = two_geoms(*names)
    size, hull = model.geom_size, hulls(model)
    mat, up = laid_on_each_other(rng, tilt)
    pos = pressed(names, mat, up, size, hull, rng)
    for dtype in np.float64, np.float32:
        given = (x.astype(dtype) for x in (pos, mat, size))
        found = values(names)(*given, hull, 0.03)
        dist, middle, _ = jax.device_get(found)
        for i in range(len(mat)):
            data = mujoco_data(model, contacts_of, pos[i], mat[i])
            near = dist[i] < 0.03
            if any(abs(c.dist - 0.03) < 1e-3 for c in data.contact):
                continue
            assert near.sum() == data.ncon
            # MuJoCo's polygon for a leaning cap has no corner where that is lowest.
            assert abs(dist[i].min() - data.contact.dist.min()) < 1e-5 + 0.05 * tilt


def mujoco_data(model, contacts_of, pos, mat):
    quat = np.zeros((2, 4))
    for k in range(2):
        mujoco.mju_mat2Quat(quat[k], mat[k].ravel())
    return contacts_of(model, [*pos[1], *quat[1]], [*pos[0], *quat[0]])


def test_derivative_of_a_tilted_caps_depth(rng, two_geoms):
    """It is that of the round rim, not of the polygon that replaces the cap."""
    names = "cylinder", "cylinder"
    size, hull = two_geoms(*names).geom_size, [None, None]
    mat, up = laid_on_each_other(rng, 0.02)
    pos = pressed(names, mat, up, size, hull, rng)
    several = np.sum(np.asarray(values(names)(pos, mat, size, hull)[0]) < 1, axis=1) > 1
    assert several.sum() > 4
    skew = np.cross(rng.normal(size=(len(mat), 1, 3)), np.eye(3))
    function = entry(names).function

    def deepest(angle, pos, mat, skew):
        turned = mat[1] + angle * skew @ mat[1] + angle**2 / 2 * skew @ (skew @ mat[1])
        first, second = (
            Shape(p, m, s) for p, m, s in zip(pos, (mat[0], turned), size, strict=True)
        )
        return jnp.min(function(first, second).dist)

    both = quick_jit(jax.vmap(jax.value_and_grad(deepest), in_axes=(None, 0, 0, 0)))
    (plus, _), (_, slope), (minus, _) = (both(h, pos, mat, skew) for h in (1e-6, 0.0, -1e-6))
    np.testing.assert_allclose(slope[several], ((plus - minus) / 2e-6)[several], atol=1e-6)
