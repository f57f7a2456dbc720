"""Rollouts as kernels are rollouts: the same numbers in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim.lanes import switch

pytest.importorskip("llvmlite")

BATCH, STEPS = 21, 10


def _difference(name: str, monkeypatch) -> float:
    """Largest difference after ten steps, relative to the largest number."""
    model = jaxsim.load(name)
    rng = np.random.default_rng(0)
    velocity = jnp.asarray(rng.normal(size=(BATCH, model.nv)))
    start = jaxsim.make_state(model)
    states = jax.vmap(lambda v: start.replace(qvel=v))(velocity)
    ctrls = jnp.asarray(rng.uniform(-1, 1, (BATCH, STEPS, model.nu)))
    expected = jaxsim.batch_rollout(model, states, ctrls, lambda s: s.qpos, status=True)
    monkeypatch.setattr(switch, "_enabled", True)
    found = jaxsim.batch_rollout(model, states, ctrls, lambda s: s.qpos, status=True)
    # Residuals of solves are what rounding leaves of large numbers.
    found, expected = found[:2], expected[:2]
    errors = [0.0]
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        if a.size and jnp.issubdtype(a.dtype, jnp.floating):
            errors.append(float(jnp.max(jnp.abs(a - b)) / jnp.maximum(1, jnp.max(jnp.abs(b)))))
    return max(errors)


def test_small_model(monkeypatch, x64):
    assert _difference("cartpole", monkeypatch) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hopper", "humanoid", "half_cheetah", "ant", "quadruped"])
def test_models_with_contacts(name, monkeypatch, x64):
    assert _difference(name, monkeypatch) < 1e-12
