"""Integrators: order, moving in configuration space, activations."""

import itertools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from random_models import random_model, random_states

from jaxsim.engine.stepping import step
from jaxsim.forces.activation import next_activation
from jaxsim.io import load
from jaxsim.joints.coordinates import difference_pos, exponential_rate, integrate_pos
from jaxsim.model import make_state

SPINNING = """
<mujoco><option gravity="0 0 0" integrator="{}" timestep="1"/><worldbody><body>
<freejoint/><geom type="box" size=".1 .2 .4" pos=".1 0 .1" mass="1"/></body></worldbody></mujoco>
"""


@pytest.fixture(autouse=True)
def float64():
    """Orders of accuracy need digits."""
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize(
    ("integrator", "order"), [("Euler", 1), ("implicit", 1), ("implicitfast", 1), ("RK4", 4)]
)
def test_order_for_a_spinning_body(integrator, order):
    model = load(SPINNING.format(integrator))
    state = make_state(model).replace(qvel=jnp.asarray([0.1, 0.2, 0.3, 1.0, 2.0, 0.5]))

    @quick_jit
    def run(dt, steps):
        timed = model.replace(opt=model.opt.replace(timestep=dt))
        return jax.lax.fori_loop(0, steps, lambda _, s: step(timed, s), state)

    ends = [run(1.0 / n, n) for n in (40, 80, 160)]
    gaps = [
        float(jnp.linalg.norm(difference_pos(model, a.qpos, b.qpos)))
        for a, b in itertools.pairwise(ends)
    ]
    assert abs(np.log2(gaps[0] / gaps[1]) - order) < 0.2
    np.testing.assert_allclose(ends[-1].time, 1.0)


def test_moving_in_configuration_space_is_that_of_mujoco():
    mj = mujoco.MjModel.from_xml_string(random_model(3))
    model = load(mj)
    qpos, qvel = random_states(mj, seed=0, n=3)
    other, _ = random_states(mj, seed=1, n=3)
    moved = jax.vmap(lambda q, v: integrate_pos(model, q, v, 0.3))(qpos, qvel)
    back = jax.vmap(lambda q, p: difference_pos(model, q, p, 0.3))(qpos, moved)
    np.testing.assert_allclose(back, qvel, rtol=1e-10, atol=1e-12)
    gap = jax.vmap(lambda q, p: difference_pos(model, q, p, 0.3))(qpos, other)
    for k in range(3):
        expected = qpos[k].copy()
        mujoco.mj_integratePos(mj, expected, qvel[k], 0.3)
        np.testing.assert_allclose(moved[k], expected, rtol=1e-12, atol=1e-12)
        difference = np.zeros(mj.nv)
        mujoco.mj_differentiatePos(mj, difference, 0.3, qpos[k], other[k])
        np.testing.assert_allclose(gap[k], difference, rtol=1e-11, atol=1e-11)


def test_rate_of_exponential_coordinates():
    """Moving theta at its rate is moving with the velocity."""
    mj = mujoco.MjModel.from_xml_string(random_model(4))
    model = load(mj)
    rng = np.random.default_rng(0)
    theta, qvel = jnp.asarray(rng.normal(size=mj.nv)), jnp.asarray(rng.normal(size=mj.nv))
    rate = exponential_rate(model, qvel, theta)
    start = integrate_pos(model, model.qpos0, theta, 1.0)
    for h in (1e-6, -1e-6):
        there = integrate_pos(model, model.qpos0, theta + h * rate, 1.0)
        np.testing.assert_allclose(difference_pos(model, start, there) / h, qvel, atol=1e-4)
    np.testing.assert_allclose(exponential_rate(model, qvel, 0 * theta), qvel, rtol=1e-12)


def test_an_exact_filter_reaches_the_closed_form():
    model = load(
        """<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody>
        <actuator><general joint="a" dyntype="filterexact" dynprm=".05"/>
        <general joint="a" dyntype="integrator" actrange="0 .3"/></actuator></mujoco>"""
    )
    act = jnp.asarray([0.2, 0.25])
    after = next_activation(model, act, jnp.asarray([(1 - 0.2) / 0.05, 9.0]), jnp.zeros(2), 0.04)
    np.testing.assert_allclose(after, [1 - 0.8 * np.exp(-0.8), 0.3], rtol=1e-12)
