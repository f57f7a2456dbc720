"""Actuators of bodies pull them to what they touch, as MuJoCo's do."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

XML = """
<mujoco><option tolerance="0" iterations="50"/><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body name="gripper" pos="0 0 .11"><freejoint/>
    <geom type="box" size=".1 .1 .1" gap=".03"/>
    <geom type="sphere" size=".1" pos=".2 0 0" margin=".01"/></body>
  <body name="ball" pos=".02 .01 .35"><freejoint/><geom size=".15" gap=".02"/></body>
</worldbody>
<actuator><adhesion body="gripper" ctrlrange="0 1" gain="5"/>
  <adhesion body="ball" ctrlrange="0 1" gain="2"/></actuator></mujoco>
"""


@pytest.mark.parametrize("slots", [None, 6])
def test_force_on_touching_and_nearly_touching_bodies(rng, slots, x64):
    mj = mujoco.MjModel.from_xml_string(XML)
    data, model = mujoco.MjData(mj), jaxsim.load(XML, max_contacts=slots)
    ctrl = np.array([0.7, 0.4])

    def pull(ctrl, qpos):
        found = jaxsim.forward(model, jaxsim.make_state(model).replace(qpos=qpos), ctrl)
        return found.qfrc_actuator, found.qacc

    both = quick_jit(lambda *at: (pull(*at), jax.jacfwd(lambda c: pull(c, at[1])[0])(at[0])))
    counts = set()
    for _ in range(8):
        mujoco.mj_resetData(mj, data)
        data.qpos[[2, 9]] += 0.03 * rng.normal(size=2)
        data.ctrl[:] = ctrl
        mujoco.mj_forward(mj, data)
        counts.add(data.ncon)
        (force, qacc), slope = both(jnp.asarray(ctrl), jnp.asarray(data.qpos))
        np.testing.assert_allclose(force, data.qfrc_actuator, atol=1e-12)
        np.testing.assert_allclose(qacc, data.qacc, atol=1e-6, rtol=1e-6)
        np.testing.assert_allclose(slope @ ctrl, force, atol=1e-12)
    assert len(counts) > 2
