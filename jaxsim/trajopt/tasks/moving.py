"""Robots that reach, jump and run."""

import jax.numpy as jnp

from jaxsim.dynamics.kinematics import kinematics
from jaxsim.io import load
from jaxsim.model import make_state
from jaxsim.trajopt.ilqr import ILQR
from jaxsim.trajopt.problem import Problem, make_problem
from jaxsim.trajopt.tasks.task import Task, square

TARGET = (0.3, -0.45, 0.5)  # of the hand (m)
HEIGHT = 1.6  # of the hopper's torso (m); 1.25 when it stands
DISTANCE = 3.0  # of the cheetah's run (m)


def reach() -> Problem:
    """A second for an arm with seven joints to bring its hand to a point, and stop."""
    model = load("arm")
    home = model.key_ctrl[0]

    def running_cost(x, u, t):
        return 0.5 * square(_to_target(model, x)) + 0.01 * square(u - home) + 1e-3 * square(x.qvel)

    def final_cost(x):
        return 500 * square(_to_target(model, x)) + 0.5 * square(x.qvel)

    return make_problem(
        model,
        make_state(model, "home"),
        horizon=50,
        running_cost=running_cost,
        final_cost=final_cost,
        frame_skip=5,
    )


def _to_target(model, x):
    return kinematics(model, x.qpos).site_xpos[0] - jnp.array(TARGET)


def _hand_miss(model, x):
    return jnp.linalg.norm(_to_target(model, x))


def jump() -> Problem:
    """Half a second for a hopper that stands to be in the air, upright."""
    model = load("hopper")
    return make_problem(
        model,
        horizon=50,
        running_cost=lambda x, u, t: 1e-3 * square(u),
        final_cost=lambda x: 100 * (x.qpos[1] - HEIGHT) ** 2 + 10 * x.qpos[2] ** 2,
        frame_skip=5,
    )


def run() -> Problem:
    """Two seconds for a cheetah that stands to be three metres on, level."""
    model, steps = load("half_cheetah"), 100

    def running_cost(x, u, t):
        ahead = x.qpos[0] - DISTANCE * (t + 1) / steps
        return 0.3 * (ahead**2 + x.qpos[2] ** 2) + 0.01 * square(u)

    return make_problem(
        model,
        horizon=steps,
        running_cost=running_cost,
        final_cost=lambda x: 50 * (x.qpos[0] - DISTANCE) ** 2 + 5 * x.qpos[2] ** 2,
        frame_skip=2,
    )


TASKS = {
    "reach": Task(
        "an arm brings its hand to a point", reach, ILQR(iterations=200), _hand_miss, 0.02
    ),
    "jump": Task(
        "a hopper jumps to a height",
        jump,
        ILQR(),
        lambda model, x: jnp.abs(x.qpos[1] - HEIGHT),
        0.05,
        starts=8,
    ),
    "run": Task(
        "a cheetah runs three metres",
        run,
        ILQR(),
        lambda model, x: jnp.abs(x.qpos[0] - DISTANCE),
        0.1,
    ),
}
