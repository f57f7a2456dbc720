"""The inverse of a step: no force is missing for the velocity that the step reaches."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint.laws import Blur
from jaxsim.engine.discrete_inverse import missing_force

# A damped mass that slides, and another that rests, on a plane; a pendulum with a limit.
XML = """<mujoco><option timestep=".01"/><default><geom friction=".4"/></default><worldbody>
  <geom name="floor" type="plane" size="0 0 1"/>
  <body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0" damping="3"/>
    <joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="2"/></body>
  <body pos="1 0 .5"><joint axis="0 1 0" damping=".2" limited="true" range="-10 10"/>
    <geom pos="0 0 -.2" size=".05" mass="1" contype="0" conaffinity="0"/></body></worldbody>
  <actuator><motor joint="x" gear="5"/></actuator></mujoco>"""


@pytest.mark.parametrize("law", ["mujoco", "sap", "lagged"])
def test_nothing_is_missing_for_a_step(x64, law):
    model = jaxsim.load(XML, contact=law)
    state = jaxsim.make_state(model).replace(
        qpos=jnp.array([0.0, -1e-3, 0.2]), qvel=jnp.array([1.0, -0.1, 0.5])
    )
    ctrl, push = jnp.array([0.7]), jnp.array([0.3, -0.2, 0.1])
    blunt, sharp = (Blur(jnp.asarray(x), jnp.asarray(0.1 * x)) for x in (0.01, 0.0))

    @quick_jit
    def missing(state):
        after = jaxsim.step(model, state.replace(qfrc_applied=push), ctrl).qvel
        given = state.replace(qfrc_applied=push)
        forces = lambda blur: missing_force(model, given, ctrl, after, blur)  # noqa: E731
        pushed = missing_force(model, state, ctrl, after)
        return forces(None), forces(sharp), forces(blunt), pushed, jax.jacfwd(forces)(blunt)

    exact, unblurred, blurred, pushed, slope = missing(state)
    np.testing.assert_allclose(exact, 0, atol=1e-7)
    np.testing.assert_allclose(unblurred, exact, atol=1e-9)
    np.testing.assert_allclose(pushed, push, atol=1e-7)
    assert np.abs(blurred[:2]).min() > 1e-3, "blur changes normal forces and friction"
    assert np.abs(blurred[2]) < 1e-7
    assert np.isfinite(slope.length).all()


# A chain with damped joints and tendon, a free body and a free body that carries another, in oil.
OIL = """<mujoco><option density="50" viscosity=".1" timestep=".005" tolerance="0"
    iterations="50"><flag invdiscrete="enable"/></option><worldbody>
  <geom name="floor" type="plane" size="0 0 1"/>
  <body pos="1 0 .5"><joint name="h" axis="0 1 0" damping=".2" limited="true" range="-10 10"/>
    <geom pos="0 0 -.2" size=".05" mass="1"/>
    <body pos=".2 0 0"><joint name="k" axis="1 1 0" damping=".05" armature=".01"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .2 .1 0"/></body></body>
  <body pos="2 0 .05"><freejoint/><geom type="box" size=".1 .2 .05"/></body>
  <body pos="3 0 .3"><freejoint/><geom type="ellipsoid" size=".1 .2 .05" fluidshape="ellipsoid"/>
    <body pos="0 0 .2"><joint type="ball" damping=".03"/><geom size=".05"/></body></body>
  </worldbody>
  <tendon><fixed damping=".4" armature=".02">
    <joint joint="h" coef="1"/><joint joint="k" coef="-.5"/></fixed></tendon>
  <actuator><velocity joint="h" kv=".4"/><damper joint="k" kv=".3" ctrlrange="0 2"/></actuator>
</mujoco>"""


@pytest.mark.parametrize(
    "integrator",
    ["IMPLICITFAST", *(pytest.param(x, marks=pytest.mark.slow) for x in ("EULER", "IMPLICIT"))],
)
def test_flag_invdiscrete_makes_inverse_that_of_a_step(integrator, x64):
    mj = mujoco.MjModel.from_xml_string(OIL)
    mj.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    data, rng = mujoco.MjData(mj), np.random.default_rng(0)
    data.qvel[:], data.ctrl[:] = 0.5 * rng.normal(size=mj.nv), [0.2, 1.1]
    mujoco.mj_step(mj, data, 5)
    mujoco.mj_forward(mj, data)
    model = jaxsim.load(mj)
    state = jaxsim.make_state(model).replace(qpos=jnp.array(data.qpos), qvel=jnp.array(data.qvel))
    ctrl, acting = jnp.array(data.ctrl), data.qfrc_actuator.copy()
    needed = quick_jit(lambda qacc: jaxsim.inverse(model, state, qacc, ctrl))
    data.qacc[:] = 3 * rng.normal(size=mj.nv)
    mujoco.mj_inverse(mj, data)
    assert data.nefc > 3
    np.testing.assert_allclose(needed(jnp.array(data.qacc)), data.qfrc_inverse, atol=1e-10)
    before = data.qvel.copy()
    mujoco.mj_step(mj, data)
    taken = (data.qvel - before) / mj.opt.timestep
    np.testing.assert_allclose(needed(jnp.array(taken)), acting, atol=1e-8)


def test_runge_kutta_has_no_discrete_inverse():
    model = jaxsim.load(OIL.replace("<option ", '<option integrator="RK4" '))
    state = jaxsim.make_state(model)
    needed = lambda qacc: jaxsim.inverse(model, state, qacc)  # noqa: E731
    with pytest.raises(jaxsim.ModelError, match="invdiscrete has no meaning with integrator RK4"):
        jax.eval_shape(needed, jnp.zeros(model.nv))
