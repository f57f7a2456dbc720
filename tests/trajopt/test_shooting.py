"""Gradients through the whole rollout, by XLA and by kernels."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim import trajopt
from jaxsim.lanes import switch

METHOD = trajopt.Shooting(optax.sgd(0.1))
CTRLS = np.array([[0.3], [-0.5], [0.8]])


def problem(model):
    return trajopt.make_problem(
        model,
        jaxsim.make_state(model).replace(qpos=jnp.array([2.0])),
        horizon=len(CTRLS),
        running_cost=lambda x, u, t: x.qpos @ x.qpos,
        final_cost=lambda x: x.qvel @ x.qvel,
        frame_skip=3,
    )


def gradient(model):
    """A step leads down a tenth of it, within the limits of the control."""
    start = METHOD.start(problem(model), jnp.asarray(CTRLS), jax.random.key(0))
    return 10 * (CTRLS - METHOD.improve(problem(model), start).memory[0])


def test_kernels_have_the_same_gradient(x64, monkeypatch):
    """Models that are mapped over go XLA's way, and the problem keeps its forward mode."""
    pytest.importorskip("llvmlite")
    model = jaxsim.load("pendulum")

    def ahead():
        return jax.jvp(lambda u: problem(model).rollout(u)[1], (CTRLS,), (np.ones_like(CTRLS),))[1]

    def with_gravity(factor):
        gravity = model.opt.gravity * factor
        return gradient(model.replace(opt=model.opt.replace(gravity=gravity)))

    plain = quick_jit(lambda: gradient(model))()
    monkeypatch.setattr(switch, "_enabled", True)
    assert "lane_call" in str(jax.make_jaxpr(lambda: gradient(model))()), "a kernel differentiates"
    found, mapped, forwards = quick_jit(
        lambda: (gradient(model), jax.vmap(with_gravity)(jnp.array([1.0, 0.5])), ahead())
    )()
    np.testing.assert_allclose(found, plain, atol=1e-12)
    np.testing.assert_allclose(mapped[0], plain, atol=1e-12)
    assert not np.allclose(mapped[1], plain)
    np.testing.assert_allclose(forwards, plain.sum(), atol=1e-12)
