"""Ellipsoids in a medium: forces and steps are MuJoCo's, and derivatives are finite at rest."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import assert_close, quick_jit, stack

import jaxsim
from jaxsim.engine.stepping import evaluate

SWIMMERS = """
<mujoco>
  <option integrator="{integrator}" density="900" viscosity=".3" wind=".5 -.2 .1" timestep=".001"/>
  <default><geom fluidshape="ellipsoid" contype="0"/></default>
  <worldbody>
    <body pos="0 0 1"><freejoint/><geom type="ellipsoid" size=".3 .05 .1" euler="10 20 30"/></body>
    <body pos="1 0 1"><freejoint/><geom type="box" size=".1 .2 .05"/>
      <body pos=".2 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".03 .2"/>
        <geom type="cylinder" size=".05 .02" pos="0 0 .1" fluidcoef=".4 .3 1 .8 .5"/>
        <body pos="0 0 .3"><joint type="ball"/><geom size=".04 .1 .03" type="ellipsoid"
          fluidshape="none"/></body></body></body>
    <body><joint type="slide"/><geom size=".1" mass="1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    "integrator", ["implicitfast", pytest.param("implicit", marks=pytest.mark.slow)]
)
def test_forces_and_steps_agree_with_mujoco(integrator, x64):
    mj = mujoco.MjModel.from_xml_string(SWIMMERS.format(integrator=integrator))
    model, data, expected = jaxsim.load(mj), mujoco.MjData(mj), []
    state, rng = jaxsim.make_state(model), np.random.default_rng(0)
    qpos, qvel = np.tile(data.qpos, (4, 1)), 2 * rng.normal(size=(4, mj.nv))
    qvel[0] = 0  # only the wind
    for q, v in zip(qpos, qvel, strict=True):
        mujoco.mj_integratePos(mj, q, rng.normal(size=mj.nv), 0.5)
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_step1(mj, data)
        fluid = data.qfrc_fluid.copy()
        mujoco.mj_step2(mj, data)
        expected.append({"qfrc_fluid": fluid, "qvel": data.qvel.copy()})

    def moved(q, v):
        now = state.replace(qpos=q, qvel=v)
        fluid = evaluate(model, now, jnp.zeros(0)).passive.qfrc_fluid
        return {"qfrc_fluid": fluid, "qvel": jaxsim.step(model, now).qvel}

    got = quick_jit(jax.vmap(moved))(qpos, qvel)
    for name, theirs in stack(expected).items():
        assert_close(got[name], theirs, 1e-10, 1e-10, name)


def test_still_water_has_finite_derivatives_and_no_force(x64):
    model = jaxsim.load(SWIMMERS.format(integrator="implicitfast"))
    model = model.replace(opt=model.opt.replace(wind=jnp.zeros(3)))
    state = jaxsim.make_state(model)

    def fluid(qvel, size, coefficients):
        swimmer = model.replace(geom_size=size, geom_fluid=coefficients)
        now = evaluate(swimmer, state.replace(qvel=qvel), jnp.zeros(0))
        return now.passive.qfrc_fluid

    at = state.qvel, model.geom_size, model.geom_fluid
    force, slopes = quick_jit(lambda *x: (fluid(*x), jax.jacrev(fluid, (0, 1, 2))(*x)))(*at)
    np.testing.assert_array_equal(force, 0)
    assert all(np.isfinite(slope).all() for slope in slopes)
    assert (np.diag(slopes[0]) <= 0).all()
    assert (np.diag(slopes[0]) < 0).sum() >= 13
