"""Contacts far stiffer than the bodies are heavy, in float32 as in float64."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

SLIPPERY = """
<mujoco>
  <option gravity="1 0 -9.81"/>
  <worldbody>
    <geom type="plane" size="2 2 1" friction="0"/>
    <body pos="0 0 .02"><freejoint/><geom type="box" size=".06 .05 .02" mass="1"/></body>
  </worldbody>
</mujoco>
"""


def _rollout(model, steps, state):
    step = lambda state, _: (jaxsim.step(model, state), None)  # noqa: E731
    return jax.lax.scan(step, state, None, length=steps)[0]


@pytest.mark.parametrize("double", [False, True])
def test_friction_of_every_size(double):
    """A box on a plane under a slanted gravity keeps its height, and slides as in MuJoCo.

    The edges of its friction pyramids weigh up to 10^10 times as much as the box.
    """
    mj, steps = mujoco.MjModel.from_xml_string(SLIPPERY), 60
    frictions = np.geomspace(1e-5, 1, 48)
    with jax.enable_x64(double):
        model = jaxsim.load(mj)
        state = jaxsim.make_state(model)

        def slide(friction):
            sliding = model.geom_friction.at[1, 0].set(friction)
            return _rollout(model.replace(geom_friction=sliding), steps, state).qpos

        found = np.asarray(quick_jit(jax.vmap(slide))(jnp.asarray(frictions)))
    for friction, qpos in zip(frictions, found, strict=True):
        mj.geom_friction[1, 0] = friction
        data = mujoco.MjData(mj)
        mujoco.mj_step(mj, data, steps)
        assert abs(qpos[2] - data.qpos[2]) < 1e-4, friction
        # MuJoCo's solver stops short of the friction of some of these steps.
        assert abs(qpos[0] - data.qpos[0]) < 1e-3, friction


def test_without_friction_in_float64(x64, bundled):
    """States of a falling box that differ by rounding go on together.

    In a pyramidal cone friction 0, raised to MuJoCo's least 1e-5, makes the stiffest contacts.
    """
    mj = bundled("box_on_plane")
    mj.geom_friction[:] = 0
    model = jaxsim.load(mj)
    start = jaxsim.make_state(model)
    qpos = np.array([0.065, -0.037, 0.126, 0.8117, 0.312, 0.3628, 0.3351])
    qpos = qpos + 1e-9 * np.random.default_rng(0).normal(size=(64, 7))
    states = jax.vmap(lambda q: start.replace(qpos=q, qvel=start.qvel.at[0].set(1.0)))(qpos)
    found = quick_jit(jax.vmap(functools.partial(_rollout, model, 8)))(states).qvel
    for q, qvel in zip(qpos, np.asarray(found), strict=True):
        data = mujoco.MjData(mj)
        data.qpos[:], data.qvel[0] = q, 1.0
        mujoco.mj_step(mj, data, 8)
        np.testing.assert_allclose(qvel, data.qvel, atol=1e-3)
