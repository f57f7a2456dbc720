"""Optimisation over positions: optima of linear problems, and contacts that it finds."""

import contact_scenes as scenes
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit
from scipy.optimize import lsq_linear

import jaxsim
from jaxsim import trajopt
from jaxsim.trajopt.tasks import TASKS

MASS = """<mujoco><option timestep=".1" gravity="0 0 0" {}/><worldbody><body>
  <joint name="x" type="slide" damping=".5"/><geom size=".1" mass="2"/></body></worldbody>
  <actuator>{}</actuator></mujoco>"""
MOTOR = '<motor joint="x" ctrllimited="true" ctrlrange="-1.5 1.5"/>'


def reach(model, horizon=12):
    """One metre, with little force."""
    return trajopt.make_problem(
        model,
        horizon=horizon,
        running_cost=lambda x, u, t: 0.01 * u @ u + 0.1 * x.qvel @ x.qvel,
        final_cost=lambda x: 50 * (x.qpos[0] - 1) ** 2 + x.qvel @ x.qvel,
    )


def best_ctrls(qpos, horizon=12, h=0.1, mass=2.0, damping=0.5):
    """The optimum of `reach`, as linear least squares in the controls within their limits."""
    v, q, rows = np.zeros(horizon + 1), np.eye(horizon + 1)[-1] * qpos, []  # last: constant part
    for u in np.eye(horizon, horizon + 1):
        rows += [0.1 * u, np.sqrt(0.1) * v]
        v = (mass * v + h * u) / (mass + h * damping)
        q = q + h * v
    rows += [np.sqrt(50) * (q - np.eye(horizon + 1)[-1]), v]
    rows = np.array(rows)
    best = lsq_linear(rows[:, :-1], -rows[:, -1], bounds=(-1.5, 1.5))
    return best.x, 2 * best.cost


def test_linear_problems_have_their_exact_optimum(x64):
    """For several starts at once, with and without active limits; the engine follows the plans."""
    model = jaxsim.load(MASS.format("", MOTOR))
    problem, method = reach(model), trajopt.InverseDynamics(tolerance=1e-6)

    @quick_jit
    @jax.vmap
    def plans(qpos):
        start = problem.start.replace(qpos=qpos)
        plan = trajopt.solve(problem.replace(start=start), method, jnp.zeros((12, 1)))
        return plan, jaxsim.rollout(model, start, plan.ctrls)[1]

    starts = 0.9, 0.85, 0.5
    plan, replay = plans(jnp.array(starts)[:, None])
    assert (plan.status == trajopt.PlanStatus.CONVERGED).all()
    assert plan.defect.max() < 1e-7
    assert np.abs(plan.ctrls).max() <= 1.5
    for i, qpos in enumerate(starts):
        ctrls, cost = best_ctrls(qpos)
        assert np.sum(np.abs(ctrls) > 1.499) == (8 if qpos == 0.5 else 0), "active limits"
        # With active limits the engine's own path, with clipped controls, ends the search early.
        limited = qpos == 0.5
        np.testing.assert_allclose(plan.cost[i], cost, rtol=1e-2 if limited else 1e-3)
        if not limited:
            np.testing.assert_allclose(plan.ctrls[i, :, 0], ctrls, atol=0.05)
    np.testing.assert_allclose(replay.qpos, plan.states.qpos[:, 1:], atol=1e-7)


@pytest.mark.parametrize(
    ("options", "actuator", "law", "message"),
    [
        ("", MOTOR, "hard", "forces that need no solve, not 'hard'"),
        ("integrator='RK4'", MOTOR, "mujoco", "needs integrator 'Euler'"),
        ("", '<general joint="x" dyntype="integrator"/>', "mujoco", "without activation"),
    ],
)
def test_what_it_cannot_do_is_an_error(options, actuator, law, message):
    model = jaxsim.load(MASS.format(options, actuator), contact=law)
    with pytest.raises(trajopt.ProblemError, match=message):
        trajopt.solve(reach(model), trajopt.InverseDynamics())


def test_bad_problems_and_guesses_are_errors():
    cost = lambda x, u, t: u @ u  # noqa: E731
    model = jaxsim.load(MASS.format("", MOTOR))
    skips = trajopt.make_problem(model, horizon=3, running_cost=cost, frame_skip=2)
    function = trajopt.make_problem(
        lambda x, u: x + u, jnp.zeros(1), horizon=3, running_cost=cost, nu=1
    )
    for problem, method, message in (
        (skips, trajopt.InverseDynamics(), "needs frame_skip=1"),
        (function, trajopt.InverseDynamics(), "dynamics that are a jaxsim.Model"),
        (reach(model), trajopt.InverseDynamics(path=np.zeros((3, 1))), r"shape \(12, 1\)"),
    ):
        with pytest.raises(trajopt.ProblemError, match=message):
            trajopt.solve(problem, method)


def check(problem, plan):
    """The plan misses no force, and the engine follows it."""
    assert plan.defect < 1e-6
    _, replay = quick_jit(lambda u: jaxsim.rollout(problem.space.model, problem.start, u))(
        plan.ctrls
    )
    np.testing.assert_allclose(replay.qpos, plan.states.qpos[1:], atol=1e-6)
    np.testing.assert_allclose(replay.qvel, plan.states.qvel[1:], atol=1e-5)


def solved(problem, method):
    """The plan from controls that are zero."""
    return quick_jit(lambda u: trajopt.solve(problem, method, u))(
        jnp.zeros((problem.horizon, problem.low.size))
    )


@pytest.mark.slow
def test_a_finger_turns_a_wheel_that_it_does_not_touch(x64):
    problem = TASKS["spin"].make()
    plan = solved(problem, trajopt.InverseDynamics(reach=0.03))
    check(problem, plan)
    np.testing.assert_allclose(plan.states.qpos[-1, 2], 2, atol=0.1)
    assert plan.cost < 6, "doing nothing costs 48"


@pytest.mark.slow
def test_a_hopper_moves_from_a_straight_line_of_positions(x64):
    """The published guess slides along the floor; multiple shooting begins with it as it is."""
    problem, path = scenes.hopper()
    line = jnp.concatenate([problem.start.qpos[None], path])
    states = jax.vmap(lambda qpos: problem.start.replace(qpos=qpos))(line)
    plan = solved(problem, trajopt.ILQR(states=states, iterations=200))
    assert plan.status == trajopt.PlanStatus.CONVERGED
    assert plan.iterations <= 20
    check(problem, plan)
    assert plan.cost < 2.4, "standing still costs more than 3"


@pytest.mark.slow
@pytest.mark.parametrize("goal", [(0.3, 0.1, 0.3), (0.4, 0.0, 0.0), (0.25, -0.1, -0.2)])
def test_a_finger_pushes_a_box_to_a_pose(x64, goal):
    problem = scenes.push(scenes.load(scenes.PUSHER, "sap", 500), jnp.array(goal))
    plan = solved(problem, trajopt.InverseDynamics(reach=0.02))
    check(problem, plan)
    np.testing.assert_allclose(plan.states.qpos[-1, :3], goal, atol=0.05)


def replanned(problem, reach, steps, heavier, braking):
    """States in closed loop with a plant that is heavier, more slippery and brakes more."""
    model, heavier = problem.space.model, jnp.array(heavier)
    plant = model.replace(
        geom_friction=0.7 * model.geom_friction,
        dof_damping=jnp.array(braking) * model.dof_damping,
        body_mass=heavier * model.body_mass,
        body_inertia=heavier[:, None] * model.body_inertia,
    )
    track = quick_jit(
        lambda u: trajopt.mpc(
            problem,
            trajopt.InverseDynamics(reach=reach),
            steps,
            u,
            first_iterations=160,
            iterations=2,
            plant=lambda x, u: jaxsim.step(plant, x, u),
        )
    )(jnp.zeros((problem.horizon, 2)))
    return track.states


@pytest.mark.slow
def test_a_finger_pushes_another_box_than_it_knows_by_planning_anew(x64):
    """The plan alone ends 10 cm too early."""
    goal = jnp.array([0.3, 0.1, 0.3])
    problem = scenes.push(scenes.load(scenes.PUSHER, "sap", 500), goal)
    states = replanned(problem, 0.02, 80, heavier=[1, 1.3, 1], braking=1.5)
    np.testing.assert_allclose(states.qpos[-20:, :3], np.tile(goal, (20, 1)), atol=0.05)


@pytest.mark.slow
def test_a_finger_turns_another_wheel_than_it_knows_by_planning_anew(x64):
    """The first push ends at a third of the way."""
    problem = TASKS["spin"].make()
    states = replanned(problem, 0.03, 160, heavier=[1, 1, 1, 1.3], braking=[1, 1, 1.5])
    np.testing.assert_allclose(states.qpos[-20:, 2], 2, atol=0.1)


@pytest.mark.slow
def test_an_arm_rolls_a_ball(x64):
    """With blurred contacts the hand finds the ball; iLQR goes on with the law itself."""
    problem, path = scenes.roller()

    @quick_jit
    def plans(ctrls):
        touching = trajopt.InverseDynamics(reach=0.01, path=path, iterations=84)
        found = trajopt.solve(problem, touching, ctrls)
        return found, trajopt.solve(problem, trajopt.ILQR(states=found.states), found.ctrls)

    _, plan = plans(jnp.zeros((problem.horizon, 7)))
    check(problem, plan)
    start, end = (plan.states.qpos[i, 7:] for i in (0, -1))
    np.testing.assert_allclose(end[:2] - start[:2], [scenes.ROLL, 0], atol=0.02)
    turned = 2 * np.arctan2(end[5], end[3])
    np.testing.assert_allclose(turned, scenes.ROLL / scenes.RADIUS, atol=0.4)
