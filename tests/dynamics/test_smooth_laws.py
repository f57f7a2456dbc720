"""Laws of passive forces and actuators: energy, power, symmetry."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from random_models import random_states
from smooth_models import FLUID, kitchen_sink
from smooth_stages import smooth

from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.rnea import qfrc_bias
from jaxsim.dynamics.transmission import actuator_moment
from jaxsim.forces.derivatives import damping_matrix, smooth_damping
from jaxsim.forces.spring import qfrc_spring
from jaxsim.io import load
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.model import make_state

STILL_FLUID = 'density="1.2" viscosity=".3"'


@pytest.fixture(scope="module")
def sink():
    """Quantities of the model with everything at four states."""
    with jax.enable_x64(True):
        mj = mujoco.MjModel.from_xml_string(kitchen_sink(option=STILL_FLUID))
        qpos, qvel = random_states(mj, seed=5, n=4)
        ctrl = np.random.default_rng(0).standard_normal((4, mj.nu))
        compute = quick_jit(jax.vmap(_quantities, in_axes=(None, 0, 0, 0)))
        return {"qvel": qvel, **compute(load(mj), qpos, qvel, ctrl)}


def _quantities(model, qpos, qvel, ctrl):
    state = make_state(model).replace(qpos=qpos, qvel=qvel)
    now = smooth(model, state, ctrl)
    kin, passive = now.motion.kin, now.passive
    damping = smooth_damping(model, kin, now.motion.vel, qvel, now.actuation)
    return {
        "damper": passive.qfrc_damper,
        "fluid": passive.qfrc_fluid,
        "spring": passive.qfrc_spring,
        "moment": actuator_moment(model, now.actuation.transmission),
        "velocity": now.actuation.actuator_velocity,
        "damping": damping_matrix(model, kin, damping),
    }


def test_dampers_and_drag_dissipate(sink):
    for name in ("damper", "fluid"):
        assert (np.sum(sink[name] * sink["qvel"], axis=1) < 0).all()


def test_actuators_see_the_velocity_that_their_moment_maps(sink):
    expected = np.einsum("nuv,nv->nu", sink["moment"], sink["qvel"])
    np.testing.assert_allclose(sink["velocity"], expected, rtol=1e-12, atol=1e-12)


def test_damping_is_symmetric(sink):
    for matrix in np.asarray(sink["damping"]):
        np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12, atol=1e-12)


def test_springs_of_joints_store_energy():
    """Around a closed loop in configuration space, springs of hinges and slides do no work."""
    model = load(
        """<mujoco><worldbody><body><joint type="slide" stiffness="3 .5 2" springref=".2"/>
        <joint name="a" stiffness="2 .3 .1"/><geom size=".1"/></body></worldbody>
        <tendon><fixed stiffness="3 1 2" springlength="-.1 .3"><joint joint="a" coef="2"/></fixed>
        </tendon></mujoco>"""
    )
    angle = np.linspace(0, 2 * np.pi, 401)
    qpos = jnp.asarray(np.stack([np.cos(angle) - 1, 0.7 * np.sin(angle)], axis=1))
    force = jax.vmap(lambda q: qfrc_spring(model, kinematics(model, q), q))(qpos)
    work = np.sum((force[1:] + force[:-1]) / 2 * np.diff(qpos, axis=0))
    assert abs(work) < 1e-3


def test_a_ball_spring_pulls_straight_back():
    model = load(
        """<mujoco><worldbody><body><joint type="ball" stiffness="3 1 2"/><geom size=".1"/></body>
        </worldbody></mujoco>"""
    )
    turn = jnp.asarray([0.3, -0.5, 0.2])
    turned = integrate_pos(model, model.qpos0, turn, 1.0)
    force = qfrc_spring(model, kinematics(model, turned), turned)
    x = np.linalg.norm(turn)
    np.testing.assert_allclose(force, -(3 + x + 2 * x**2) * turn, rtol=1e-12)


def test_a_body_that_drifts_with_the_wind_feels_no_drag():
    model = load(
        f"""<mujoco><option {FLUID}/><worldbody><body><freejoint/>
        <geom type="box" size=".1 .2 .3"/></body></worldbody></mujoco>"""
    )
    state = make_state(model)
    drifting = state.replace(qvel=jnp.asarray([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))
    compute = quick_jit(lambda s: smooth(model, s, None).passive.qfrc_fluid)
    for s, is_zero in ((drifting, True), (state, False)):
        drag = compute(s)
        assert (np.abs(drag).max() < 1e-12) == is_zero


def test_full_gravity_compensation_leaves_no_weight():
    model = load(
        """<mujoco><worldbody><body gravcomp="1"><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
        <body gravcomp="1" pos=".2 0 0"><joint type="ball"/><geom size=".1" pos=".3 0 0"/></body>
        </body></worldbody></mujoco>"""
    )

    @quick_jit
    def compute(state):
        now = smooth(model, state, None)
        return qfrc_bias(model, now.motion.kin, now.motion.vel), now.passive.qfrc_passive

    weight, compensation = compute(make_state(model))
    assert np.abs(weight).max() > 1
    np.testing.assert_allclose(compensation, weight, rtol=1e-12, atol=1e-12)


def test_controls_default_to_zero():
    model = load(
        """<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody>
        <actuator><position joint="a" kp="2"/></actuator></mujoco>"""
    )
    state = make_state(model).replace(qpos=jnp.asarray([0.5]))
    assert float(smooth(model, state, None).actuation.actuator_force[0]) == -1.0
