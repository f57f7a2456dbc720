"""What a task sees is what `mjData` holds after `mj_step`, stale quantities included."""

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.envs.base.advance import advance
from jaxsim.envs.base.moment import Moment

XML = """
<mujoco>
  <option timestep="0.01" integrator="{integrator}" iterations="100" tolerance="0"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 0.28">
      <freejoint/>
      <geom type="sphere" size="0.3"/>
      <body pos="0.4 0 0">
        <joint name="arm" type="hinge" axis="0 1 0" limited="true" range="-10 10"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
        <site name="tip" pos="0.5 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="arm" gear="5"/></actuator>
</mujoco>
"""
FIELDS = (
    "qpos qvel xpos xquat xipos geom_xpos site_xpos subtree_com cinert cvel qfrc_actuator "
    "qfrc_constraint qacc cfrc_ext"
).split()
START = np.array([0.1, 0, -0.2, 0.3, 0, 0.5, 0.4])


def _mujoco(integrator: str, steps: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    mj = mujoco.MjModel.from_xml_string(XML.format(integrator=integrator))
    data = mujoco.MjData(mj)
    data.qvel[:], data.ctrl[:] = START, 0.7
    if steps:
        mujoco.mj_step(mj, data, nstep=steps)
        mujoco.mj_rnePostConstraint(mj, data)
    else:
        mujoco.mj_forward(mj, data)
    return mj, data


@quick_jit
def _stepped(model, state, ctrl):
    found = advance(model, state, ctrl, 3)
    return _seen(Moment(model, found.after, found.last, ctrl, ctrl, {}, found.qacc))


@quick_jit
def _at_reset(model, state, ctrl):
    return _seen(Moment(model, state, state, ctrl, ctrl, {}))


def _seen(now: Moment):
    return {name: getattr(now, name) for name in FIELDS}


def _compare(found, data):
    for name in FIELDS:
        expected = np.array(getattr(data, name))
        np.testing.assert_allclose(
            found[name], expected, atol=1e-9 * max(1, np.abs(expected).max()), err_msg=name
        )


# Runge-Kutta averages rotation vectors here and angular velocities in MuJoCo, so that one agrees
# to the order of the method only; the tasks of Gymnasium that use it have no free joints.
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.usefixtures("x64")
def test_moment_after_steps(integrator):
    mj, data = _mujoco(integrator, steps=3)
    model = jaxsim.load(mj)
    state = jaxsim.envs.start_from(model, model.qpos0, START)
    _compare(_stepped(model, state, jnp.full(1, 0.7)), data)


@pytest.mark.usefixtures("x64")
def test_moment_at_a_reset():
    mj, data = _mujoco("Euler", steps=0)
    model = jaxsim.load(mj)
    state = jaxsim.envs.start_from(model, model.qpos0, START)
    _compare(_at_reset(model, state, jnp.full(1, 0.7)), data)


@pytest.mark.usefixtures("x64")
def test_moment_after_runge_kutta_is_that_of_the_fourth_stage():
    mj = mujoco.MjModel.from_xml_string(XML.format(integrator="RK4").replace("<freejoint/>", ""))
    data = mujoco.MjData(mj)
    data.qvel[:], data.ctrl[:] = 40.0, 0.7
    mujoco.mj_step(mj, data, nstep=3)
    mujoco.mj_rnePostConstraint(mj, data)
    model = jaxsim.load(mj)
    state = jaxsim.envs.start_from(model, model.qpos0, np.array([40.0]))
    found = _stepped(model, state, jnp.full(1, 0.7))
    assert np.abs(data.qfrc_constraint).max() > 1  # the joint's limit acts
    _compare(found, data)
