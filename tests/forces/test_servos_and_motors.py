"""PID servos, servos of orientations and DC motors move bodies as MuJoCo's do."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from oracle import quick_jit

import jaxsim
from jaxsim.io.constants import set_const

XML = """
<mujoco><option timestep=".003" integrator="{}"><flag contact="disable"/></option>
<worldbody><site name="world" euler="0 30 10"/>
  <body><joint name="h1" axis="0 1 0" damping=".05"/>
    <geom size=".05 .2" type="capsule" pos=".1 0 .1"/>
    <body pos="0 0 .4"><joint name="h2" axis="1 0 0" damping=".05"/>
      <geom size=".05 .2" type="capsule" pos="0 .1 .1"/>
      <body pos="0 0 .4"><joint name="ball" type="ball" damping=".02"/>
        <geom size=".05 .1 .2" type="box" pos="0 .1 .1"/>
        <site name="tip" pos="0 .1 .2" euler="10 20 30"/></body></body></body>
  <body pos="1 0 0"><joint name="alone" type="ball" damping=".05"/>
    <geom size=".1 .05 .1" type="box" pos=".1 0 .05"/></body>
</worldbody>
<tendon><fixed name="t"><joint joint="h1" coef=".7"/><joint joint="h2" coef="-.4"/></fixed></tendon>
<actuator>
  <motor joint="h1"/>
  <pid joint="h1" kp="3" kv=".4" ki="2" imax=".2" slewmax="5" input="pos vel ff"
    posrange="-1 1" velrange="-2 2" ffrange="-.5 .5"/>
  <pid joint="ball" gear=".3 1 2 0 0 0" kp="3" dampratio=".5" ki="1" slewmax="30"/>
  <pid tendon="t" kp="3" kv=".4" input="vel ff"/>
  <orientation joint="alone" kp="4" kv=".3" {}/>
  <orientation name="o" site="tip" refsite="world" kp="4" dampratio=".3" input="quat"/>
  <general joint="ball" gaintype="so3" biastype="so3" dyntype="integrator" gainprm="2"
    biasprm=".1 -2 -.1" actearly="true"/>
  <dcmotor name="d" joint="h2" motorconst=".05" resistance="2" inductance=".01 0"
    cogging=".02 6 .3" lugre="20 .1 .05 .1 .2" thermal="2 3 25 .004 25 40"
    controller="2 1 .1 8 .3 12" saturation=".4 0 50" input="pos vel ff voltage"/>
  <dcmotor joint="h1" motorconst=".05" resistance="2" group="3"/>
  <dcmotor joint="h2" motorconst=".05" resistance="2" input="none" lugre="20 .1 .05 .1 .2"/>
</actuator>
<sensor><actuatorpos actuator="o"/><actuatorvel actuator="o"/><actuatorfrc actuator="d"/>
  <actuatorfrc actuator="o"/></sensor></mujoco>
"""
READ = "actuator_length actuator_velocity actuator_force act_dot qfrc_actuator sensordata".split()


def loaded(integrator="Euler", limit=""):
    xml = XML.format(integrator, limit)
    return mujoco.MjModel.from_xml_string(xml), jaxsim.load(xml, rotations="mujoco")


def controls(rng, mj, steps):
    return np.repeat(rng.normal(size=(steps // 5, mj.nu)) * 2, 5, axis=0)


INTEGRATORS = ["Euler", "implicitfast"] + [
    pytest.param(name, marks=pytest.mark.slow) for name in ("implicit", "RK4")
]


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_trajectory(integrator, rng):
    # MuJoCo's implicit integrators leave it to rounding whether a torque is at its limit.
    mj, model = loaded(integrator, 'forcerange="0 1.5"' if integrator in ("Euler", "RK4") else "")
    data, ctrls, states = mujoco.MjData(mj), controls(rng, mj, 200), []
    for ctrl in ctrls:
        data.ctrl[:] = ctrl
        mujoco.mj_step(mj, data)
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
    run = quick_jit(lambda ctrls: jaxsim.rollout(model, jaxsim.make_state(model), ctrls))
    final, found = run(jnp.asarray(ctrls))
    found = np.concatenate([found.qpos, found.qvel, found.act], axis=1)
    np.testing.assert_allclose(found, states, atol=1e-10, rtol=1e-10)
    if integrator != "Euler":
        return
    mujoco.mj_forward(mj, data)
    now = quick_jit(jaxsim.forward)(model, final, jnp.asarray(data.ctrl))
    for name in READ:
        expected = getattr(data, name)
        np.testing.assert_allclose(getattr(now, name), expected, atol=1e-10, err_msg=name)
    assert np.isclose(np.linalg.norm(data.actuator_force[4:7]), 1.5)


@pytest.mark.slow
def test_gradients_nan_and_constants(rng):
    mj, model = loaded()
    ctrl = jnp.asarray(rng.normal(size=mj.nu))
    state = jaxsim.make_state(model)
    state = state.replace(
        qvel=jnp.asarray(rng.normal(size=mj.nv)), act=jnp.asarray(0.1 * rng.normal(size=mj.na))
    )
    names = ("actuator_gainprm", "actuator_biasprm", "actuator_dynprm")

    def after(x):
        numbers, qvel, act, ctrl = x
        here = model.replace(**dict(zip(names, numbers, strict=True)))
        moved = jaxsim.step(here, state.replace(qvel=qvel, act=act), ctrl)
        return jnp.concatenate([moved.qvel, moved.act])

    at = ([getattr(model, n) for n in names], state.qvel, state.act, ctrl)
    flat, back = ravel_pytree(at)
    along = jnp.asarray(rng.normal(size=flat.shape)) * (flat != 0)
    weight = jnp.asarray(rng.normal(size=mj.nv + mj.na))

    def all_of(v):
        moved, forward = jax.jvp(lambda v: after(back(v)), (v,), (along,))
        return moved, forward, jax.grad(lambda v: weight @ after(back(v)))(v)

    ways = [flat, flat + 1e-6 * along, flat - 1e-6 * along, flat.at[-1].set(jnp.nan)]
    moved, forward, reverse = quick_jit(jax.vmap(all_of))(jnp.stack(ways))
    np.testing.assert_allclose(forward[0], (moved[1] - moved[2]) / 2e-6, atol=1e-6, rtol=1e-6)
    np.testing.assert_allclose(reverse[0] @ along, weight @ forward[0], rtol=1e-9)
    assert np.isfinite(reverse[0]).all()
    assert np.isnan(moved[3]).any()
    again = quick_jit(set_const)(model)
    for name in ("actuator_length0", "actuator_acc0"):
        np.testing.assert_allclose(getattr(again, name), getattr(mj, name), atol=1e-10)


def test_disabled_actuators_rest(rng):
    mj, model = loaded()
    mj.opt.disableactuator = 1
    model = jaxsim.load(mj)
    data = mujoco.MjData(mj)
    data.qvel[:] = rng.normal(size=mj.nv)
    data.ctrl[:] = rng.normal(size=mj.nu)
    state = jaxsim.make_state(model).replace(qvel=jnp.asarray(data.qvel))
    moved = quick_jit(jaxsim.step)(model, state, jnp.asarray(data.ctrl))
    mujoco.mj_step(mj, data)
    np.testing.assert_allclose(moved.qvel, data.qvel, atol=1e-12)
    np.testing.assert_allclose(moved.act, data.act, atol=1e-12)
    assert np.count_nonzero(data.actuator_force) == 1  # group 3
