"""Motions whose contacts the optimiser finds by itself."""

import jax.numpy as jnp

from jaxsim.io import load
from jaxsim.model import make_state
from jaxsim.trajopt.inverse_dynamics import InverseDynamics
from jaxsim.trajopt.problem import Problem, make_problem
from jaxsim.trajopt.tasks.task import Task, square

TURN = 2.0  # of the wheel (rad)

# A finger of two links and a wheel, seen from above; the tip is 8 cm from the wheel at first. A pin
# shows how the wheel turns.
_SPINNER = """
<mujoco model="spin">
  <option timestep="0.05" gravity="0 0 0"/>
  <default>
    <joint axis="0 1 0" damping="0.1"/>
    <geom friction="0.5"/>
    <default class="look"><geom contype="0" conaffinity="0" mass="0"/></default>
  </default>
  <worldbody>
    <light pos="1 -4 4" dir="0 0.7 -0.7"/>
    <camera name="track" pos="0.8 -3 0.9" xyaxes="1 0 0 0 0 1"/>
    <body name="upper">
      <inertial pos="0 0 0.5" mass="1" diaginertia="0.0839 0.0839 0.00125"/>
      <joint name="shoulder"/>
      <geom class="look" type="capsule" fromto="0 0 0 0 0 1" size="0.05" rgba="0.5 0.55 0.6 1"/>
      <body name="lower" pos="0 0 1">
        <inertial pos="0 0 0.5" mass="1" diaginertia="0.0839 0.0839 0.00125"/>
        <joint name="elbow"/>
        <geom class="look" type="capsule" fromto="0 0 0 0 0 0.9" size="0.04"
              rgba="0.5 0.55 0.6 1"/>
        <geom name="tip" pos="0 0 0.95" size="0.05" rgba="0.9 0.5 0.2 1"/>
      </body>
    </body>
    <body name="wheel" pos="1.5 0 1">
      <inertial pos="0 0 0" mass="1" diaginertia="0.054 0.074 0.022"/>
      <joint name="wheel"/>
      <geom name="wheel" size="0.25" rgba="0.3 0.5 0.8 1"/>
      <geom class="look" type="capsule" fromto="0 -0.26 0 0 -0.26 0.2" size="0.02"
            rgba="0.95 0.9 0.3 1"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="shoulder"/>
    <motor joint="elbow"/>
  </actuator>
</mujoco>
"""


def spin() -> Problem:
    """Two seconds for a finger to turn a wheel, by touch; nothing else moves it."""
    soft = {"stiffness": 400.0}
    model = load(_SPINNER, contact="lagged", materials={"tip": soft, "wheel": soft})
    start = make_state(model).replace(qpos=jnp.array([0.3, 1.5, 0.0]))
    goal = start.qpos.at[2].set(TURN)

    def cost(x):
        return square(x.qpos - goal) + 0.1 * square(x.qvel)

    return make_problem(
        model,
        start,
        horizon=40,
        running_cost=lambda x, u, t: 0.05 * (cost(x) + 0.1 * square(u)),
        final_cost=lambda x: 10 * cost(x),
    )


TASKS = {
    "spin": Task(
        "a finger turns a wheel that it does not touch at first",
        spin,
        InverseDynamics(reach=0.03),
        lambda model, x: jnp.abs(x.qpos[2] - TURN),
        0.1,
        double=True,
    ),
}
