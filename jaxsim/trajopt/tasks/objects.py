"""Objects that are thrown and pushed."""

import jax.numpy as jnp

from jaxsim.io import load
from jaxsim.model import make_state
from jaxsim.trajopt.ilqr import ILQR
from jaxsim.trajopt.problem import Problem, make_problem
from jaxsim.trajopt.tasks.task import Task, square

TARGET = (2.5, 0.8)  # of the ball: along the floor and up (m)
RELEASE = 8  # controls after which the ball is on its own
POSE = (0.4, 0.1, 0.5)  # of the box: x, y (m), turn (rad)

# The floor is a spring and a damper that lose a third of the ball's speed. Forces grow from zero
# when it touches, so that the time of the impact has a derivative.
_BALL = """
<mujoco model="throw">
  <option timestep="0.005"/>
  <worldbody>
    <light pos="1 -3 4" dir="0 0.6 -0.8"/>
    <geom name="floor" type="plane" size="5 2 1" rgba="0.8 0.8 0.8 1"/>
    <site name="target" pos="2.5 0 0.8" size="0.08" rgba="0.2 0.7 0.3 0.5"/>
    <body name="ball" pos="0 0 1">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom name="ball" size="0.08" mass="0.5" condim="1" solref="-4000 -20" solimp="0 0.95 0.02"
            rgba="0.9 0.5 0.2 1"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="x" gear="20" ctrllimited="true" ctrlrange="-1 1"/>
    <motor joint="z" gear="20" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""

_PUSHER = """
<mujoco model="push">
  <option timestep="0.01"/>
  <worldbody>
    <light pos="0 -2 3" dir="0 0.6 -0.8"/>
    <geom name="table" type="plane" size="1 1 1" contype="0" conaffinity="0" rgba="0.8 0.8 0.8 1"/>
    <site name="goal" type="box" size="0.1 0.1 0.02" pos="0.4 0.1 0.05" euler="0 0 28.6479"
          rgba="0.2 0.7 0.3 0.4"/>
    <body name="box" pos="0 0 0.05">
      <joint name="x" type="slide" axis="1 0 0" frictionloss="1" damping="1"/>
      <joint name="y" type="slide" axis="0 1 0" frictionloss="1" damping="1"/>
      <joint name="turn" axis="0 0 1" frictionloss="0.05" damping="0.05"/>
      <geom name="box" type="box" size="0.1 0.1 0.05" mass="0.5" rgba="0.3 0.5 0.8 1"/>
    </body>
    <body name="finger" pos="-0.14 -0.02 0.05">
      <joint name="finger_x" type="slide" axis="1 0 0" damping="5"/>
      <joint name="finger_y" type="slide" axis="0 1 0" damping="5"/>
      <geom name="finger" size="0.04" mass="0.5" condim="3" friction="0.5" solimp="0 0.95 0.01"
            rgba="0.9 0.5 0.2 1"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="finger_x" gear="20" ctrllimited="true" ctrlrange="-1 1"/>
    <motor joint="finger_y" gear="20" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


def throw() -> Problem:
    """A ball is pushed for a moment, and shall be on the target 1.2 seconds later, after a bounce.

    The time is too long for a direct flight with the forces there are.
    """
    model = load(_BALL)

    def running_cost(x, u, t):
        return jnp.where(t < RELEASE, 1e-3, 3.0) * square(u)

    return make_problem(
        model,
        horizon=60,
        running_cost=running_cost,
        final_cost=lambda x: 500 * _ball_miss(model, x) ** 2,
        frame_skip=4,
    )


def _ball_miss(model, x):
    place = x.qpos + jnp.array([0.0, 1.0])
    return jnp.sqrt(square(place - jnp.array(TARGET)) + 1e-12)


def push() -> Problem:
    """A finger pushes a box along a table with friction to a place and a turn."""
    model = load(_PUSHER)

    def running_cost(x, u, t):
        return 1e-3 * square(u) + 1e-3 * square(x.qvel) + 0.05 * _box_miss(model, x) ** 2

    return make_problem(
        model,
        make_state(model),
        horizon=75,
        running_cost=running_cost,
        final_cost=lambda x: 100 * _box_miss(model, x) ** 2 + square(x.qvel[:3]),
        frame_skip=2,
    )


def _box_miss(model, x):
    return jnp.sqrt(square(x.qpos[:3] - jnp.array(POSE)) + 1e-12)


TASKS = {
    "throw": Task("a ball meets a target after a bounce", throw, ILQR(), _ball_miss, 0.05),
    "push": Task("a finger pushes a box to a pose", push, ILQR(), _box_miss, 0.05),
}
