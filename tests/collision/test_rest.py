"""Bodies in flat contact come to rest where MuJoCo's do, in float32 too."""

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

SCENE = """<mujoco><option timestep="0.004"/><asset>
  <mesh name="block" vertex="-.1 -.1 -.05 .1 -.1 -.05 .1 .1 -.05 -.1 .1 -.05
    -.1 -.1 .05 .1 -.1 .05 .1 .1 .05 -.1 .1 .05"/></asset><worldbody>
  <geom type="box" size=".3 .3 .1" pos="0 0 .1" contype="3" conaffinity="3"/>
  <body pos="0 0 .252"><freejoint/><geom type="mesh" mesh="block"/></body>
  <body pos=".02 .01 .354" euler="0 0 30"><freejoint/><geom type="mesh" mesh="block"/></body>
  <body pos="0 0 .466"><freejoint/><geom type="cylinder" size=".08 .06"/></body>
  <body pos=".2 0 .252" euler="90 0 10"><freejoint/><geom type="cylinder" size=".05 .1"
    contype="2" conaffinity="2"/></body>
</worldbody></mujoco>"""


@pytest.mark.slow
def test_a_pile_comes_to_rest_as_mujocos():
    """A tower of two meshes and a cylinder, and a cylinder lying, on a box, for 1 s."""
    model = jaxsim.load(SCENE)
    state = jaxsim.make_state(model)
    final, _ = quick_jit(jaxsim.rollout)(model, state, jnp.zeros((250, 0)))
    mj = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(mj)
    mujoco.mj_step(mj, data, 250)
    np.testing.assert_allclose(final.qpos, data.qpos, atol=2e-3)
    heights = np.arange(mj.nbody - 1) * 7 + 2
    np.testing.assert_allclose(np.asarray(final.qpos)[heights], data.qpos[heights], atol=2e-4)
    assert np.abs(final.qvel).max() < 0.02
