"""iLQR from a guess of the states: gaps are closed, and what remains is a plan like any other."""

import jax
import jax.numpy as jnp
import linear
import numpy as np
import pytest

import jaxsim
from jaxsim import trajopt

CONVERGED, DIVERGED = trajopt.PlanStatus.CONVERGED, trajopt.PlanStatus.DIVERGED


def test_one_step_solves_a_linear_quadratic_problem(x64, rng):
    problem, guess = linear.problem(), rng.normal(size=(linear.HORIZON + 1, 3))
    method = trajopt.ILQR(damping=0.0, tolerance=1e-13, states=guess)
    plan = trajopt.solve(problem, method, rng.normal(size=(linear.HORIZON, 2)))
    assert plan.status == CONVERGED
    assert plan.iterations == 2, "the guess, and one step"
    gains, value = linear.riccati()
    np.testing.assert_allclose(plan.gains, gains, atol=1e-8)
    np.testing.assert_allclose(plan.cost, 0.5 * linear.START @ value @ linear.START, rtol=1e-10)
    assert plan.defect == 0
    np.testing.assert_allclose(problem.rollout(plan.ctrls)[0], plan.states, atol=1e-10)


def test_an_explosion_is_planned_from_the_goal():
    """Controls of zero let the state grow to infinity. Its gaps close step by step."""
    problem = trajopt.make_problem(
        lambda x, u: x + 0.1 * (x**3 + u),
        jnp.array([3.0]),
        horizon=20,
        running_cost=lambda x, u, t: 0.1 * (x @ x + 0.1 * u @ u),
        final_cost=lambda x: 10 * x @ x,
        nu=1,
    )
    none = jnp.zeros((20, 1))
    assert trajopt.solve(problem, trajopt.ILQR(), none).status == DIVERGED
    at_goal = jnp.zeros((21, 1))
    early, plan = (
        trajopt.solve(problem, trajopt.ILQR(iterations=n, states=at_goal), none) for n in (3, 100)
    )
    assert 0 < early.defect < 5.7, "the first gap is 3 + 0.1 3^3"
    assert plan.status == CONVERGED
    assert plan.defect == 0
    states, cost = problem.rollout(plan.ctrls)
    np.testing.assert_allclose(states, plan.states, atol=1e-5)
    np.testing.assert_allclose(cost, plan.cost, rtol=1e-6)
    # Its own states, whose gaps are rounding errors, are a guess that has nothing left to do.
    again = trajopt.solve(problem, trajopt.ILQR(states=plan.states), plan.ctrls)
    assert again.status == CONVERGED
    assert again.iterations <= 3
    np.testing.assert_allclose(again.cost, plan.cost, rtol=1e-5)


@pytest.mark.slow
def test_a_pendulum_swings_up_along_a_straight_line():
    """With controls of zero, at which a pendulum that hangs would stay."""
    model = jaxsim.load("pendulum")
    start = jaxsim.make_state(model).replace(qpos=jnp.array([jnp.pi]))
    problem = trajopt.make_problem(
        model,
        start,
        horizon=60,
        running_cost=lambda x, u, t: 0.1 * (1 - jnp.cos(x.qpos[0])) + 1e-3 * u @ u,
        final_cost=lambda x: 20 * (1 - jnp.cos(x.qpos[0])) + x.qvel @ x.qvel,
    )
    line = jnp.linspace(start.qpos, 0, 61)
    states = jax.vmap(lambda qpos: start.replace(qpos=qpos))(line)
    plan = trajopt.solve(problem, trajopt.ILQR(states=states), jnp.zeros((60, 1)))
    assert plan.status == CONVERGED
    assert plan.defect == 0
    last = jax.tree.map(lambda x: x[-1], plan.states)
    assert np.cos(last.qpos[0]) > 0.99
    assert abs(last.qvel[0]) < 0.1
    np.testing.assert_allclose(problem.rollout(plan.ctrls)[1], plan.cost, rtol=1e-4)


def test_a_guess_of_the_wrong_kind_or_shape():
    states = jnp.zeros((linear.HORIZON, 3))
    with pytest.raises(trajopt.ProblemError, match=r"states must have shape \(21, 3\), got \(20"):
        trajopt.solve(linear.problem(), trajopt.ILQR(states=states))
    model = jaxsim.load("pendulum")
    problem = trajopt.make_problem(model, horizon=5, running_cost=lambda x, u, t: 0.0)
    with pytest.raises(trajopt.ProblemError, match="like the start, a State, got a ndarray"):
        trajopt.solve(problem, trajopt.ILQR(states=np.zeros((6, 2))))
    with pytest.raises(trajopt.ProblemError, match=r"states.qpos must have shape \(6, 1\), got"):
        trajopt.solve(problem, trajopt.ILQR(states=problem.start))
