"""`forward` and MuJoCo at the same states: constraints of all kinds, both cones."""

import importlib.util
import pathlib

import jax
import mujoco
import numpy as np
import pytest
from instants import (
    DOUBLE,
    SINGLE,
    assert_instants,
    batch_states,
    converging,
    forward_all,
    rollout,
)
from oracle import assert_close, quick_jit
from random_models import CONSTRAINED, random_model
from scenes import SCENES

from jaxsim.engine.report import forward, inverse
from jaxsim.io import load

CASES = [(name, "pyramidal") for name in SCENES] + [("floor", "elliptic"), ("pile", "elliptic")]
GYMNASIUM = (
    "hopper half_cheetah walker2d_v5 ant humanoid inverted_double_pendulum swimmer"
).split()
FILES = [f"gymnasium/envs/mujoco/assets/{name}.xml" for name in GYMNASIUM] + [
    "mujoco/mjx/test_data/humanoid/humanoid.xml",
    "mujoco/mjx/test_data/constraints.xml",
]


@pytest.mark.parametrize(("scene", "cone"), CASES)
def test_small_scenes(scene, cone):
    mj = converging(SCENES[scene], cone)
    datas = rollout(mj, 12, 15, seed=1, spread=0.5)
    assert np.mean([d.nefc for d in datas]) > 3
    assert_instants(mj, datas, forward_all(load(mj), datas), DOUBLE)


@pytest.mark.parametrize(
    ("scene", "cone"),
    [("floor", "elliptic"), pytest.param("limits", "pyramidal", marks=pytest.mark.slow)],
)
def test_small_scenes_in_single_precision(scene, cone, x32):
    mj = converging(SCENES[scene], cone)
    datas = rollout(mj, 12, 15, seed=1, spread=0.5)
    assert_instants(mj, datas, forward_all(load(mj), datas), SINGLE)


@pytest.mark.slow
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("path", FILES)
def test_models_of_other_packages(path, cone):
    mj = converging(_locate(path), cone)
    datas = rollout(mj, 10, 25)
    for key in range(min(mj.nkey, 3)):
        datas += rollout(mj, 4, 4, key=key)
    assert_instants(mj, datas, forward_all(load(mj), datas), DOUBLE)


@pytest.mark.slow
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("name", ["four_bar", "spheres", "box_on_plane"])
def test_bundled_models(name, cone, bundled):
    mj = converging(bundled(name), cone)
    datas = rollout(mj, 10, 25)
    assert_instants(mj, datas, forward_all(load(mj), datas), DOUBLE)


@pytest.mark.parametrize(
    "seed", [pytest.param(s, marks=() if s < 2 else pytest.mark.slow) for s in range(100)]
)
def test_random_models(seed):
    mj = converging(
        random_model(seed, CONSTRAINED, bodies=3 + seed % 3, self_collision=seed % 2 == 1),
        ("pyramidal", "elliptic")[seed // 2 % 2],
    )
    datas = rollout(mj, 6, 10, seed=seed)
    assert_instants(mj, datas, forward_all(load(mj), datas), DOUBLE)


@pytest.mark.parametrize("scene", ["floor", pytest.param("equalities", marks=pytest.mark.slow)])
def test_inverse_returns_the_applied_forces(scene, rng):
    mj = converging(SCENES[scene], "elliptic")
    datas = rollout(mj, 6, 15, seed=1, spread=0.5)
    for data in datas:
        data.qfrc_applied[:] = rng.normal(size=mj.nv)
        mujoco.mj_forward(mj, data)
    states, ctrl = batch_states(load(mj), datas)

    def both(model, state, ctrl):
        return inverse(model, state, forward(model, state, ctrl).qacc)

    got = quick_jit(jax.vmap(both, (None, 0, 0)))(load(mj), states, ctrl)
    applied = np.stack([d.qfrc_applied + d.qfrc_actuator for d in datas])
    assert_close(got, applied, 1e-6, 1e-6, "inverse")


def _locate(path: str) -> str:
    package, _, rest = path.partition("/")
    (root,) = importlib.util.find_spec(package).submodule_search_locations
    return str(pathlib.Path(root) / rest)
