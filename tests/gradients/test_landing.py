"""A falling leg, whose foot lands and bounces, and whose knee is free or meets its limits."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

from jaxsim import load, make_state, step, vmap
from jaxsim.gradients import Backward

LEG = """
<mujoco>
  <option timestep="{dt}" iterations="30" ls_iterations="30" tolerance="1e-12" cone="elliptic"/>
  <default><geom solref=".04 .5" solimp=".95 .95 .001" friction=".5 .005 .0001" contype="0"
    conaffinity="0"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="1"/>
    <body pos="0 0 .75">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
      <geom type="box" size=".1 .05 .05"/>
      <body><joint axis="0 1 0" stiffness="30" damping="1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 -.3" size=".03"/>
        <body pos=".1 0 -.3">
          <joint axis="0 1 0" stiffness="30" damping="1" {knee}/>
          <geom type="capsule" fromto="0 0 0 -.1 0 -.3" size=".03"/>
          <geom pos="-.15 0 -.3" size=".04" mass=".1" conaffinity="1"/>
          <geom pos="0 0 -.33" size=".04" mass=".1" conaffinity="1"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
START = np.array([0, 0.1, 0, 0, 0, 0.5, -1.0, 0, 0, 0])
TIME, WINDOW = 0.3, 0.008


def secant(knee: str) -> np.ndarray:
    """Change of the final state by that of the height, from MuJoCo with short steps."""
    mj = mujoco.MjModel.from_xml_string(LEG.format(dt=2e-5, knee=knee))
    ends = []
    for height in (0, WINDOW):
        data = mujoco.MjData(mj)
        data.qpos[:], data.qvel[:] = START[: mj.nq], START[mj.nq :]
        data.qpos[1] += height
        for _ in range(round(TIME / 2e-5)):
            mujoco.mj_step(mj, data)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    return (ends[1] - ends[0]) / WINDOW


def slopes(knee: str, entry_time: bool) -> np.ndarray:
    """Derivatives at 40 heights of that window, with steps of 1 ms."""
    model = load(LEG.format(dt=1e-3, knee=knee), backward=Backward(entry_time=entry_time))

    def end(height):
        x = jnp.asarray(START).at[1].add(height)
        state = make_state(model).replace(qpos=x[: model.nq], qvel=x[model.nq :])
        state = lax.fori_loop(0, round(TIME / 1e-3), lambda _, s: step(model, s), state)
        return jnp.concatenate([state.qpos, state.qvel])

    heights = (np.arange(40) + 0.5) / 40 * WINDOW
    return np.asarray(quick_jit(vmap(jax.jacfwd(end)))(heights))


@pytest.mark.slow
@pytest.mark.parametrize("knee", ["", 'limited="true" range="-3 3"'], ids=["free", "limited"])
def test_a_landing(knee, x64):
    """The mean is that of the motion to 10 per cent; without the option it is off by its size.

    With a free knee the foot leaves the ground while friction still presses it down.
    """
    truth = secant(knee)
    plain, found = slopes(knee, False).mean(axis=0), slopes(knee, True).mean(axis=0)
    size = np.linalg.norm(truth)
    assert np.linalg.norm(found - truth) < 0.1 * size
    assert np.linalg.norm(plain - truth) > size
