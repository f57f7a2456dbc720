"""Kernels as a GPU's threads run them, one lane and long pieces, on a CPU: they are the step."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim.io import bundled_models

pytest.importorskip("llvmlite")

from jaxsim.lanes import compiler, switch
from jaxsim.lanes.gpu import ptx

STATES = 4
# Rounding in single precision, 1e-7, times the condition: at most 6e-6, and a chain's 2e-5.
TOLERANCE = 1e-4


@pytest.fixture
def threads(monkeypatch):
    """Kernels for one lane have the pieces of a GPU, under names of their own."""
    made = compiler._emitter
    monkeypatch.setattr(compiler, "_emitter", functools.partial(made, longest=ptx.LONGEST))
    monkeypatch.setattr(compiler, "_sources", lambda: "pieces of a GPU")
    monkeypatch.setattr(switch, "_enabled", False)
    return lambda: monkeypatch.setattr(switch, "_enabled", True)


def _visited(model, step):
    """States of a simulation with random velocities and controls, and the controls."""
    rng = np.random.default_rng(0)
    state, found = jaxsim.make_state(model), []
    state = state.replace(qvel=jnp.asarray(rng.normal(size=model.nv), jnp.float32))
    for _ in range(STATES):
        for _ in range(5):
            ctrl = jnp.asarray(rng.uniform(-1, 1, model.nu), jnp.float32)
            state = step(state, ctrl)
        found.append((state, ctrl))
    return found


def _difference(name: str, use_kernels) -> float:
    """Largest difference of states after a step, relative to the largest number."""
    model = jaxsim.load(name)
    plain = jax.jit(lambda s, u: jaxsim.step(model, s, u))
    visited = _visited(model, plain)
    use_kernels()
    kernel = jax.jit(lambda s, u: jaxsim.step(model, s, u))
    assert "jaxsim_lanes" in kernel.lower(*visited[0]).as_text()
    worst = 0.0
    for state, ctrl in visited:
        a, b = kernel(state, ctrl), plain(state, ctrl)
        for x, y in ((a.qpos, b.qpos), (a.qvel, b.qvel), (a.act, b.act)):
            assert x.dtype == y.dtype
            if x.size:
                error = jnp.max(jnp.abs(x - y)) / jnp.maximum(1, jnp.max(jnp.abs(y)))
                worst = max(worst, float(error))
    return worst


def test_a_small_model(threads):
    assert _difference("cartpole", threads) < TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in bundled_models() if n != "cartpole"])
def test_bundled_models(name, threads):
    assert _difference(name, threads) < TOLERANCE
