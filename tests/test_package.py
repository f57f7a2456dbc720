"""The package as a user meets it: import, names, documentation, bundled models."""

import importlib
import inspect
import pkgutil
import subprocess
import sys

import jax
import mujoco
import numpy as np
import pytest

import jaxsim
import jaxsim.io

PUBLIC = (
    "Model",
    "State",
    "batch_rollout",
    "forward",
    "forward_dynamics",
    "inverse_dynamics",
    "load",
    "make_state",
    "mass_matrix",
    "rollout",
    "step",
    "vmap",
)

MODELS = jaxsim.io.bundled_models()

# Meshes and most pairs of solids are supported, but the bundled models keep to the cheap ones.
CHEAP_PAIRS = {
    frozenset(pair)
    for pair in (
        ("plane", "sphere"),
        ("plane", "capsule"),
        ("plane", "box"),
        ("plane", "cylinder"),
        ("plane", "ellipsoid"),
        ("sphere", "sphere"),
        ("sphere", "capsule"),
        ("capsule", "capsule"),
    )
}

IMPORT_ONLY = """
import jax, numpy, warnings
def settings():
    return dict(jax.config.values), numpy.geterr(), numpy.get_printoptions(), warnings.filters[:]
before = settings()
import jaxsim
import jaxsim.io
assert settings() == before, "importing jaxsim changed a global setting"
from jax._src import xla_bridge
assert not xla_bridge.backends_are_initialized(), "importing jaxsim started a backend"
"""


def test_import_is_silent_and_changes_no_setting():
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ONLY], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_exists_and_is_documented(name):
    thing = getattr(jaxsim, name)
    assert name in jaxsim.__all__
    assert len(inspect.getdoc(thing).split()) > 5


def test_every_listed_name_exists():
    assert [name for name in jaxsim.__all__ if not hasattr(jaxsim, name)] == []


def test_every_module_has_a_docstring():
    modules = [m.name for m in pkgutil.walk_packages(jaxsim.__path__, "jaxsim.")]
    silent = [
        name
        for name in modules
        if not name.endswith("__main__") and not importlib.import_module(name).__doc__
    ]
    assert len(modules) > 20
    assert silent == []


def test_there_are_bundled_models():
    assert {"pendulum", "humanoid", "four_bar"} <= set(MODELS)


@pytest.mark.parametrize("name", MODELS)
def test_bundled_model_is_stable_in_mujoco(name, bundled):
    """Two seconds under random controls: no warning, bounded speeds, only cheap contact pairs."""
    model = bundled(name)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    low, high = model.actuator_ctrlrange.T
    pairs = set()
    for step in range(int(2 / model.opt.timestep)):
        if step % 10 == 0:
            data.ctrl[:] = rng.uniform(low, high)
        mujoco.mj_step(model, data)
        pairs |= {frozenset(_kinds(model, contact)) for contact in data.contact}
    assert sum(warning.number for warning in data.warning) == 0
    assert np.abs(data.qvel).max() < 100
    assert pairs <= CHEAP_PAIRS


# Gymnasium's robot lies 36 mm deep in the floor when it starts to stand up.
@pytest.mark.parametrize("name", [name for name in MODELS if name != "humanoid_standup"])
def test_bundled_model_starts_without_penetration(name, bundled):
    model = bundled(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert min((contact.dist for contact in data.contact), default=0) > -1e-3


@pytest.mark.parametrize("name", ["pendulum", "humanoid"])
def test_bundled_model_loads_by_name(name, bundled):
    model = jaxsim.load(name)
    oracle = bundled(name)
    assert (model.nq, model.nv, model.nu) == (oracle.nq, oracle.nv, oracle.nu)
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(model))


def _kinds(model, contact) -> tuple[str, str]:
    return tuple(
        mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        for geom in contact.geom
    )
