"""Limits whose margins reach across the range, so that both ends push at once."""

import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

XML = """
<mujoco>
  <option solver="Newton" tolerance="0" iterations="50"/>
  <worldbody>
    <body><geom size=".1"/><joint name="knee" axis="0 1 0" range="-2 3" margin=".2"/></body>
    <body pos="1 0 0"><geom size=".1"/><joint name="wide" range="-30 30" margin=".1"/></body>
    <body pos="2 0 0"><geom size=".1"/><joint name="slide" type="slide" axis="1 0 0"/></body>
  </worldbody>
  <tendon>
    <fixed name="t" range="-.1 .2" margin=".3"><joint joint="slide" coef="1.5"/></fixed>
  </tendon>
  <sensor>
    <jointlimitpos joint="knee"/><jointlimitvel joint="knee"/><jointlimitfrc joint="knee"/>
    <jointlimitfrc joint="wide"/>
    <tendonlimitpos tendon="t"/><tendonlimitvel tendon="t"/><tendonlimitfrc tendon="t"/>
  </sensor>
</mujoco>
"""
# The positions of knee (rad), wide (rad) and slide (m).
STATES = {
    "both": (0.01, 0.0, 0.02),
    "nearer the upper end": (0.05, 0.5, 0.1),
    "only the upper end": (0.18, 0.0, 0.3),
    "only the lower end": (-0.2, -0.5, -0.3),
}


@pytest.mark.parametrize("state", STATES)
def test_forces_and_sensors_are_those_of_mujoco(x64, state):
    mj = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:] = STATES[state], (0.3, -0.2, 0.1)
    mujoco.mj_forward(mj, data)
    model = jaxsim.load(mj)
    now = jaxsim.make_state(model).replace(qpos=data.qpos.copy(), qvel=data.qvel.copy())
    found = quick_jit(jaxsim.forward)(model, now)
    np.testing.assert_allclose(found.qacc, data.qacc, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.sensordata, data.sensordata, rtol=1e-9, atol=1e-9)


def test_in_the_middle_of_the_range_the_forces_of_both_ends_cancel(x64):
    model = jaxsim.load(XML)
    middle = np.array([np.deg2rad(0.5), 0.0, 0.05 / 1.5])
    found = quick_jit(jaxsim.forward)(model, jaxsim.make_state(model).replace(qpos=middle))
    np.testing.assert_allclose(found.qacc, 0, atol=1e-9)
    force = found.sensordata[np.array([2, 6])]
    assert np.all(force > 1)
