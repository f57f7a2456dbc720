"""Spatial tendons against MuJoCo, and their derivatives."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import assert_close, quick_jit
from random_models import random_states
from tendon_models import tendon_model

import jaxsim
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.tendons.tendon import tendon_jacobian, tendon_velocity
from jaxsim.joints.coordinates import integrate_pos

CONVERGED = 'integrator="implicitfast" iterations="200" tolerance="1e-14"'
# MuJoCo ends its search for the point where a tendon passes a ring at an error of 1e-6.
RINGS = ("sphere_inside", "cylinder_inside")
STATES = 24


@pytest.fixture(scope="module")
def scene():
    """Our quantities and MuJoCo's at the same states."""
    with jax.enable_x64(True):
        mj = mujoco.MjModel.from_xml_string(tendon_model(CONVERGED))
        inputs = *random_states(mj, seed=1, n=STATES), _controls(mj)
        model = jaxsim.load(mj)
        ours = quick_jit(jax.vmap(lambda *x: quantities(model, *x)))(*inputs)
        return model, inputs, ours, [oracle(mj, *x) for x in zip(*inputs, strict=True)]


def quantities(model, qpos, qvel, ctrl):
    """Lengths, Jacobian, and all that follows from them."""
    kin = kinematics(model, qpos)
    state = jaxsim.make_state(model).replace(qpos=qpos, qvel=qvel)
    now = jaxsim.forward(model, state, ctrl)
    return {
        "ten_length": kin.ten_length,
        "ten_velocity": tendon_velocity(model, kin, qvel),
        "ten_J": tendon_jacobian(model, kin),
        **{n: getattr(now, n) for n in ("qfrc_passive", "qfrc_actuator", "qacc", "sensordata")},
        "potential": now.energy[0],
        "next": jaxsim.step(model, state, ctrl).qvel,
    }


def oracle(mj, qpos, qvel, ctrl) -> dict:
    """The same of MuJoCo, and how often each tendon wraps."""
    mj.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_forward(mj, data)
    found = {n: getattr(data, n).copy() for n in ("ten_length", "ten_velocity", "qfrc_passive")}
    found |= {n: getattr(data, n).copy() for n in ("qfrc_actuator", "qacc", "sensordata")}
    found["ten_J"] = np.zeros((mj.ntendon, mj.nv))
    for i, (start, n) in enumerate(zip(mj.ten_J_rowadr, mj.ten_J_rownnz, strict=True)):
        found["ten_J"][i, mj.ten_J_colind[start : start + n]] = data.ten_J[start : start + n]
    spans = zip(data.ten_wrapadr, data.ten_wrapnum, strict=True)
    found["wraps"] = [(data.wrap_obj.ravel()[a : a + n] >= 0).any() for a, n in spans]
    found["potential"] = data.energy[0]
    mujoco.mj_step(mj, data)
    return found | {"next": data.qvel.copy()}


def _controls(mj):
    return np.random.default_rng(0).uniform(-1, 1, (STATES, mj.nu))


def test_some_states_wrap_and_some_do_not(scene):
    wraps = np.array([x["wraps"] for x in scene[3]])
    for name in ("sphere", "sphere_side", "cylinder", *RINGS):
        assert set(wraps[:, scene[0].names.id("tendon", name)]) == {False, True}, name


@pytest.mark.parametrize("name", ["ten_length", "qfrc_passive", "potential"])
def test_lengths_and_springs(scene, name):
    for k, theirs in enumerate(scene[3]):
        np.testing.assert_allclose(scene[2][name][k], theirs[name], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", ["ten_J", "ten_velocity"])
def test_jacobian(scene, name):
    model = scene[0]
    rings = [model.names.id("tendon", ring) for ring in RINGS]
    for k, theirs in enumerate(scene[3]):
        for t in range(model.ntendon):
            atol = 1e-6 if t in rings else 1e-10
            np.testing.assert_allclose(scene[2][name][k, t], theirs[name][t], atol=atol)


@pytest.mark.parametrize("name", ["qfrc_actuator", "qacc", "sensordata", "next"])
def test_forces_and_motion(scene, name):
    # The error of MuJoCo's rings, see above.
    theirs = np.stack([x[name] for x in scene[3]])
    assert_close(scene[2][name], theirs, atol=1e-8, rtol=1e-6, what=name)


def test_lengths_change_as_the_jacobian_says(scene):
    model, (qpos, qvel, _), ours, _ = scene
    lengths = quick_jit(jax.vmap(lambda q: kinematics(model, q).ten_length))
    move = jax.vmap(lambda q, v, h: integrate_pos(model, q, v, h), (0, 0, None))
    h = 1e-5
    rate = (lengths(move(qpos, qvel, h)) - lengths(move(qpos, qvel, -h))) / (2 * h)
    # Half of the states are away from where some tendon begins to touch something.
    error = np.abs(rate - ours["ten_velocity"]).max(1)
    assert np.median(error) < 1e-7
    assert error.max() < 1e-2


@pytest.mark.slow
def test_derivatives_of_lengths_and_jacobian(scene):
    model, (qpos, qvel, _), ours, _ = scene

    def along(q, v):
        def at(t):
            kin = kinematics(model, integrate_pos(model, q, v, t))
            return kin.ten_length, tendon_velocity(model, kin, v)

        return *jax.jvp(at, (0.0,), (1.0,))[1], at(1e-5)[1], at(-1e-5)[1]

    rate, second, after, before = quick_jit(jax.vmap(along))(qpos, qvel)
    np.testing.assert_allclose(rate, ours["ten_velocity"], atol=1e-9)
    error = np.abs(second - (after - before) / 2e-5) / (1 + np.abs(second))
    assert np.isfinite(second).all()
    assert np.median(error.max(1)) < 1e-6


def test_lengths_in_float32(scene):
    _, (qpos, _, _), ours, _ = scene
    with jax.enable_x64(False):
        model = jaxsim.load(tendon_model())
        kin = quick_jit(jax.vmap(lambda q: kinematics(model, q)))(jnp.asarray(qpos, jnp.float32))
    np.testing.assert_allclose(kin.ten_length, ours["ten_length"], atol=1e-5)
    np.testing.assert_allclose(kin.spatial_J, ours["ten_J"][:, :-1], atol=1e-3)
