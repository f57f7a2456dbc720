"""Robots that stand on their feet: derivatives through 32 steps are those of the program."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from instants import batch_states, converging
from jax import lax
from oracle import quick_jit

import jaxsim

STEPS, SETTLED, WAYS = 32, 150, 4
SIZES = (1e-4, 1e-5, 1e-6)
POINTS = np.array([-2.0, -1.0, 1.0, 2.0])
FIVE_POINT = np.array([1.0, -8.0, 8.0, -1.0]) / 12


def landed(mj):
    """Data when the robot has come down onto its feet."""
    data = mujoco.MjData(mj)
    for _ in range(SETTLED):
        mujoco.mj_step(mj, data)
    assert data.ncon > 0
    return data


@pytest.mark.slow
@pytest.mark.parametrize("name", ["humanoid", "ant", "half_cheetah", "hopper"])
def test_action_gradients(name, bundled, rng, x64):
    """Both modes agree to 1e-10, and with differences in float64 to 1e-5.

    Differences are five-point ones along random directions, of three sizes: large ones may cross a
    change of contacts, small ones lose digits, so the nearest counts.
    """
    mj = converging(bundled(name), integrator=mujoco.mjtIntegrator.mjINT_EULER)
    model, data = jaxsim.load(mj), landed(mj)
    state = jax.tree.map(lambda x: x[0], batch_states(model, [data])[0])
    ctrl = 0.1 * rng.normal(size=(STEPS, model.nu))
    ways = rng.normal(size=(WAYS, STEPS, model.nu))
    weight = rng.normal(size=model.nq + model.nv)

    def loss(ctrl):
        step = jax.checkpoint(lambda s, u: (jaxsim.step(model, s, u), None))
        after, _ = lax.scan(step, state, ctrl)
        return weight @ jnp.concatenate([after.qpos, after.qvel])

    forward = lambda way: jax.jvp(loss, (ctrl,), (way,))[1]  # noqa: E731
    both = quick_jit(lambda: (jax.grad(loss)(ctrl), jax.vmap(forward)(ways)))()
    gradient, slopes = (np.asarray(x) for x in both)
    scale = np.abs(slopes).max()
    np.testing.assert_allclose(np.einsum("kti,ti->k", ways, gradient), slopes, atol=1e-10 * scale)
    moves = np.multiply.outer(np.multiply.outer(SIZES, POINTS), ways)
    values = quick_jit(jax.vmap(loss))((ctrl + moves).reshape(-1, STEPS, model.nu))
    sums = np.einsum("hpk,p->hk", np.asarray(values).reshape(moves.shape[:3]), FIVE_POINT)
    error = np.abs(sums / np.array(SIZES)[:, None] - slopes).min(axis=0)
    assert (error < 1e-5 * scale).all()
