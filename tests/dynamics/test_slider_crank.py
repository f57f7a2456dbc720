"""Slider-crank transmissions agree with MuJoCo, and their moments are derivatives of lengths."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.transmission import actuator_moment, transmission

XML = """
<mujoco><worldbody><site name="rail" pos="0 0 1" euler="0 80 10"/>
  <body pos="0 0 1"><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
    <site name="end" pos=".2 .05 .1"/>
    <body pos=".5 0 0"><joint axis="0 1 .3"/><geom size=".1" pos=".3 0 0"/>
      <site name="guide" pos=".1 0 0" euler="30 20 10"/></body></body>
  <body pos="0 .5 1"><joint axis="1 0 0"/><geom size=".1" pos="0 .2 0"/>
    <site name="other" pos="0 .1 .2"/></body>
</worldbody><actuator>
  <general cranksite="end" slidersite="rail" cranklength=".5" gear="3"/>
  <general cranksite="other" slidersite="guide" cranklength="1.4" biastype="affine"
    biasprm="1 2 3"/>
  <general name="short" cranksite="other" slidersite="rail" cranklength=".05"/>
</actuator><sensor><actuatorpos actuator="short"/></sensor></mujoco>
"""


def test_lengths_moments_and_accelerations_agree_with_mujoco(x64):
    mj = mujoco.MjModel.from_xml_string(XML)
    model, data, ctrl = jaxsim.load(mj), mujoco.MjData(mj), jnp.array([1.0, -2.0, 0.5])
    state, rng = jaxsim.make_state(model), np.random.default_rng(0)

    def ours(qpos, qvel):
        found = transmission(model, kinematics(model, qpos), qpos)
        slope = jax.jacfwd(lambda q: transmission(model, kinematics(model, q), q).length)(qpos)
        now = jaxsim.forward(model, state.replace(qpos=qpos, qvel=qvel), ctrl)
        return found.length, actuator_moment(model, found), slope, now.qacc

    compute = quick_jit(ours)
    for _ in range(4):
        data.qpos[:], data.qvel[:], data.ctrl[:] = *rng.normal(size=(2, mj.nv)), ctrl
        mujoco.mj_forward(mj, data)
        length, moment, slope, qacc = compute(jnp.array(data.qpos), jnp.array(data.qvel))
        np.testing.assert_allclose(length, data.actuator_length, atol=1e-12)
        np.testing.assert_allclose(slope, moment, atol=1e-12)
        np.testing.assert_allclose(moment @ data.qvel, data.actuator_velocity, atol=1e-12)
        np.testing.assert_allclose(qacc, data.qacc, 1e-9, 1e-9)
