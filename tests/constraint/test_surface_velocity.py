"""Surfaces that move: accelerations are MuJoCo's, and a box on a belt reaches the belt's speed."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

BELT = """
<mujoco><option cone="{cone}" timestep=".004"/><worldbody>
  <geom type="box" size="3 3 .1" pos="0 0 -.1" surfacevel=".5 .2 .3 0 0 .4" euler="0 0 30"/>
  <body pos=".3 .1 .0495"><freejoint/><geom type="box" size=".1 .1 .05" condim="{condim}"/></body>
  <body pos="-.5 .2 .0999"><freejoint/><geom size=".1" condim="{condim}" surfacevel="0 .1 0 0 0 1"/>
  </body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize(
    ("cone", "condim"),
    [("elliptic", 6), *(pytest.param("pyramidal", c, marks=pytest.mark.slow) for c in (1, 3, 4))],
)
def test_accelerations_agree_with_mujoco(cone, condim, x64):
    mj = mujoco.MjModel.from_xml_string(BELT.format(cone=cone, condim=condim))
    mj.opt.tolerance, mj.opt.iterations = 0, 200
    data = mujoco.MjData(mj)
    data.qvel[:] = np.random.default_rng(0).normal(size=mj.nv) * 0.1
    mujoco.mj_forward(mj, data)
    model = jaxsim.load(mj)
    state = jaxsim.make_state(model).replace(qvel=jnp.array(data.qvel))

    def qacc(surface):
        return jaxsim.forward(model.replace(geom_surfacevel=surface), state).qacc

    at = model.geom_surfacevel
    got, slope = quick_jit(lambda: jax.jvp(qacc, (at,), (jnp.ones_like(at),)))()
    np.testing.assert_allclose(got, data.qacc, 1e-7, 1e-7)
    assert np.isfinite(slope).all()


@pytest.mark.slow
def test_a_box_on_a_belt_reaches_its_speed():
    xml = BELT.format(cone="elliptic", condim=3).replace(".5 .2 .3 0 0 .4", ".5 0 0 0 0 0")
    model = jaxsim.load(xml.replace(' euler="0 0 30"', ""))
    final, _ = jaxsim.rollout(model, jaxsim.make_state(model), jnp.zeros((400, 0)))
    np.testing.assert_allclose(final.qvel[:6], [0.5, 0, 0, 0, 0, 0], atol=1e-3)
