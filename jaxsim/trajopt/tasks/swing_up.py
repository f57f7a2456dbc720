"""Swing-ups: from hanging at rest to standing at rest, with motors too weak to lift directly."""

import jax.numpy as jnp

from jaxsim.io import load
from jaxsim.model import make_state
from jaxsim.trajopt.ilqr import ILQR
from jaxsim.trajopt.problem import Problem, make_problem
from jaxsim.trajopt.tasks.task import Task, square


def pendulum() -> Problem:
    """Three seconds for a rod with a motor of 2 N m, where 5 would lift it."""
    model = load("pendulum")
    return make_problem(
        model,
        make_state(model).replace(qpos=jnp.array([jnp.pi])),
        horizon=60,
        running_cost=lambda x, u, t: 0.1 * (1 - jnp.cos(x.qpos[0])) + 1e-3 * square(u),
        final_cost=lambda x: 20 * (1 - jnp.cos(x.qpos[0])) + square(x.qvel),
    )


def cartpole() -> Problem:
    """Two seconds for a pole on a cart that ends where it began."""
    model = load("cartpole")

    def running_cost(x, u, t):
        place = 0.1 * (1 - jnp.cos(x.qpos[1])) + 0.01 * x.qpos[0] ** 2
        return place + 1e-3 * square(x.qvel) + 0.01 * square(u)

    def final_cost(x):
        return 100 * (1 - jnp.cos(x.qpos[1])) + 50 * x.qpos[0] ** 2 + 5 * square(x.qvel)

    return make_problem(
        model,
        make_state(model).replace(qpos=jnp.array([0.0, jnp.pi])),
        horizon=100,
        running_cost=running_cost,
        final_cost=final_cost,
        frame_skip=2,
    )


def acrobot() -> Problem:
    """Eight seconds for two rods with a motor in the elbow only."""
    model = load("acrobot")

    def below(x):
        """How far the elbow and the tip are below where they stand, in lengths of a rod."""
        return 2 - jnp.cos(x.qpos[0]) - jnp.cos(x.qpos[0] + x.qpos[1])

    return make_problem(
        model,
        make_state(model).replace(qpos=jnp.array([jnp.pi, 0.0])),
        horizon=200,
        running_cost=lambda x, u, t: 0.01 * (below(x) + square(u)) + 1e-4 * square(x.qvel),
        final_cost=lambda x: 50 * below(x) + 5 * square(x.qvel),
        frame_skip=4,
    )


def _tilt(*joints: int):
    """The largest angle to upright of rods whose angles are sums of these first joints'."""

    def miss(model, x):
        angles = jnp.cumsum(x.qpos[jnp.array(joints)])
        return jnp.abs(jnp.arctan2(jnp.sin(angles), jnp.cos(angles))).max()

    return miss


TASKS = {
    "pendulum": Task("a rod swings up and stands", pendulum, ILQR(), _tilt(0), 0.1),
    "cartpole": Task("a pole swings up on a cart that comes back", cartpole, ILQR(), _tilt(1), 0.1),
    "acrobot": Task(
        "two rods swing up by the elbow alone", acrobot, ILQR(iterations=150), _tilt(0, 1), 0.1
    ),
}
