"""The package as a user meets it: import, names, documentation, bundled models."""

import importlib.util
import inspect
import pathlib
import pkgutil
import subprocess
import sys

import jax
import mujoco
import numpy as np
import pytest

import jaxsim
import jaxsim.io

DOCS = pathlib.Path(__file__).parents[1] / "docs"
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
from jaxsim import envs, gradients, rl, sysid, trajopt, viz
from jax._src import xla_bridge
assert not xla_bridge.backends_are_initialized(), "importing jaxsim started a backend"
"""


def test_import_is_silent_and_changes_no_setting():
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ONLY], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.fixture(scope="module")
def index():
    """The module that writes the index of public names."""
    spec = importlib.util.spec_from_file_location("generate_api", DOCS / "generate_api.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_index_of_public_names_is_fresh(index):
    """Otherwise run `python docs/generate_api.py`."""
    assert (DOCS / "api.md").read_text("utf-8") == index.page()


def test_public_names_are_listed_and_documented(index):
    for package in map(importlib.import_module, index.PACKAGES):
        taken = {n for n, v in vars(package).items() if not n.startswith("_") and _is_api(v)}
        taken -= {"set_const"}  # `jaxsim.model.set_const` is the name of earlier versions
        assert taken <= set(package.__all__), package.__name__
        for name in set(package.__all__) - set(index.CONSTANTS):
            assert len(inspect.getdoc(getattr(package, name)).split()) > 3, name


def test_no_public_name_hides_a_module():
    modules = {m.name for m in pkgutil.iter_modules(jaxsim.__path__)}
    assert modules & set(jaxsim.__all__) == set()


def test_errors_have_one_base_and_are_public(index):
    public = {
        getattr(package, name)
        for package in map(importlib.import_module, index.PACKAGES)
        for name in package.__all__
        if inspect.isclass(getattr(package, name))
    }
    names = [m.name for m in pkgutil.walk_packages(jaxsim.__path__, "jaxsim.")]
    private = ("jaxsim.__main__", "jaxsim.cli")
    for module in (importlib.import_module(n) for n in names if not n.startswith(private)):
        for _, error in inspect.getmembers(module, inspect.isclass):
            if issubclass(error, Exception) and error.__module__ == module.__name__:
                assert issubclass(error, jaxsim.JaxsimError)
                assert error in public


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


def _is_api(thing) -> bool:
    """Whether a thing is a function or a class of jaxsim."""
    return getattr(thing, "__module__", "").startswith("jaxsim") and callable(thing)


def _kinds(model, contact) -> tuple[str, str]:
    return tuple(
        mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        for geom in contact.geom
    )
