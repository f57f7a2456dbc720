"""Settings and fixtures of the whole suite: strict JAX, two CPU devices, MuJoCo as the oracle."""

import importlib
import os
from importlib import resources
from pathlib import Path

import jax
import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import jaxsim

if "JAX_PLATFORMS" not in os.environ:
    jax.config.update("jax_platforms", "cpu")
# Broadcasting between arrays of different rank is nearly always a mistake in code for one item.
jax.config.update("jax_numpy_rank_promotion", "raise")
# Two devices even on one core, so that whatever shards a batch is really tested.
jaxsim.configure_cpu(2, lanes="JAXSIM_LANES" in os.environ)

# Compilation makes the first example slow, so a deadline says nothing; examples are reproducible.
settings.register_profile(
    "jaxsim",
    deadline=None,
    max_examples=30,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("jaxsim")

# A compiled program holds dozens of memory maps. Linux allows a process 65,530 of them; one with
# more can neither fork nor start another program.
_MAPS = Path("/proc/self/maps")
_MANY_MAPS = 20_000


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Forget the compiled programs of earlier modules when they have become many."""
    yield
    if _MAPS.exists() and len(_MAPS.read_bytes().splitlines()) > _MANY_MAPS:
        jax.clear_caches()


ASSETS = resources.files("jaxsim") / "assets"
BENCHMARKS = Path(__file__).parent.parent / "benchmarks"


@pytest.fixture
def x64():
    """Float64 for the test that asks for it."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(0)


@pytest.fixture
def key() -> jax.Array:
    """A random key with a fixed seed."""
    return jax.random.key(0)


@pytest.fixture
def benchmark_module(monkeypatch):
    """Function from the name of a benchmark's module to it, imported as the benchmarks do."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


@pytest.fixture
def bundled():
    """Function from the name of a bundled model to its MjModel."""
    return lambda name: mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml"))


@pytest.fixture
def oracle():
    """Function from MJCF text to (MjModel, MjData after mj_forward)."""

    def build(xml: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        return model, data

    return build
