"""Second and third derivatives of steps in loops, against differences of derivatives of one less.

The loss is nonlinear in the state that a step or two lead to. At all states near the start a rod
touches the plane, with friction, and no row changes between active and inactive.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

import jaxsim

pytestmark = pytest.mark.usefixtures("x64")

ROD = """
<mujoco>
  <option integrator="{}" iterations="50" tolerance="0"/>
  <worldbody>
    <geom type="plane" size="0 0 1" friction=".6 .005 .0001"/>
    <body pos="0 0 .3">
      <joint name="hinge" axis="0 1 0" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 .4 0 -.28" size=".03"/></body>
  </worldbody>
  <actuator><motor joint="hinge" gear="3"/></actuator>
</mujoco>
"""
POINT = np.array([0.03, 0.3, 0.7])  # qpos, qvel, ctrl
H = 1e-5  # of differences
MODES = jax.jacfwd, jax.jacrev


def loss(advance, integrator: str = "Euler"):
    """A function of position, velocity and control, by how a state is taken further."""
    model = jaxsim.load(ROD.format(integrator))
    start = jaxsim.make_state(model)

    def f(x):
        state = advance(model, start.replace(qpos=x[:1], qvel=x[1:2]), x[2:])
        return jnp.sum(jnp.sin(3 * state.qpos) + state.qvel**2 * state.qpos)

    return f


def scan(model, state, ctrl):
    return lax.scan(lambda s, _: (jaxsim.step(model, s, ctrl), None), state, length=2)[0]


def rollout(model, state, ctrl):
    """It has checkpoints."""
    return jaxsim.rollout(model, state, jnp.stack([ctrl, ctrl**2]))[0]


def differences(f):
    """Central differences at the point, along the last axis of the result."""
    f = quick_jit(f)
    slopes = [(f(POINT + d) - f(POINT - d)) / (2 * H) for d in H * np.eye(len(POINT))]
    return np.stack(slopes, axis=-1)


def assert_close(found, expected, tolerance: float) -> None:
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


# Differences are right to about 1e-16 / H + H^2 of the scale of the next derivatives but one.
@pytest.mark.parametrize(
    ("advance", "integrator"),
    [
        pytest.param(scan, "Euler", id="scan"),
        pytest.param(jaxsim.step, "RK4", id="RK4", marks=pytest.mark.slow),
        pytest.param(rollout, "Euler", id="rollout", marks=pytest.mark.slow),
        pytest.param(rollout, "implicitfast", id="implicitfast", marks=pytest.mark.slow),
    ],
)
def test_hessian(advance, integrator):
    f = loss(advance, integrator)
    hessian = quick_jit(jax.hessian(f))(POINT)
    assert_close(hessian, hessian.T, 1e-13)
    assert_close(hessian, differences(jax.grad(f)), 2e-8)


@pytest.mark.slow
def test_all_orders_of_modes_agree():
    f = loss(scan)
    orders = list(itertools.product(MODES, MODES))
    found = [quick_jit(second(first(f)))(POINT) for first, second in orders]
    for hessian in found[1:]:
        assert_close(hessian, found[0], 1e-12)


@pytest.mark.slow
def test_third_derivatives():
    f = loss(scan)
    third = quick_jit(jax.jacfwd(jax.hessian(f)))(POINT)
    assert_close(third, differences(jax.hessian(f)), 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_batches(vmap):
    """Of Hessians, and the Hessian of a batch."""
    f = loss(scan)
    hessian = quick_jit(jax.hessian(f))
    points = POINT + 1e-3 * np.arange(3)[:, None]
    expected = np.stack([hessian(x) for x in points])
    assert_close(quick_jit(vmap(jax.hessian(f)))(points), expected, 1e-11)
    total = quick_jit(jax.hessian(lambda shift: jnp.sum(vmap(f)(points + shift[None]))))
    assert_close(total(np.zeros(3)), expected.sum(0), 1e-11)
