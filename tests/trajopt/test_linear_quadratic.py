"""Every method on linear systems, where Riccati's recursion and least squares have the answer."""

import jax
import jax.numpy as jnp
import linear
import numpy as np
import optax
import pytest
import scipy.optimize

from jaxsim import trajopt

RUNNING = trajopt.PlanStatus.RUNNING


def test_ilqr_is_riccatis_recursion(x64):
    plan = trajopt.solve(linear.problem(), trajopt.ILQR(damping=0.0, tolerance=1e-13))
    gains, value = linear.riccati()
    assert plan.status == trajopt.PlanStatus.CONVERGED
    assert plan.iterations == 2, "the guess, and one step"
    np.testing.assert_allclose(plan.gains, gains, atol=1e-8)
    np.testing.assert_allclose(plan.cost, 0.5 * linear.START @ value @ linear.START, rtol=1e-10)
    before = np.asarray(plan.states[:-1])
    np.testing.assert_allclose(plan.ctrls, np.einsum("tij,tj->ti", gains, before), atol=1e-8)


def test_bounded_ilqr_solves_bounded_quadratic_programs(x64, rng):
    """From several starts at once."""
    limits = (np.array([-1.5, -0.4]), np.array([0.7, 2.0]))
    bounds = tuple(np.tile(limit, linear.HORIZON) for limit in limits)
    starts = rng.normal(size=(3, 3))

    def solve(start):
        problem = linear.problem(limits).replace(start=start)
        return trajopt.solve(problem, trajopt.ILQR(tolerance=1e-14))

    plans = jax.vmap(solve)(jnp.asarray(starts))
    assert np.all(plans.status == trajopt.PlanStatus.CONVERGED)
    for i, start in enumerate(starts):
        m, c = linear.least_squares(start)
        best = scipy.optimize.lsq_linear(m, -c, bounds, method="bvls", tol=1e-14)
        held = np.isclose(best.x, bounds[0]) | np.isclose(best.x, bounds[1])
        assert 2 < held.sum() < held.size - 2, "the example has held and free controls"
        unevaluated = 0.5 * start @ linear.Q @ start  # what no control can change
        np.testing.assert_allclose(plans.cost[i], best.cost + unevaluated, rtol=1e-10)
        np.testing.assert_allclose(np.ravel(plans.ctrls[i]), best.x, atol=1e-6)
        # A held control does not answer to the state.
        assert not np.any(plans.gains[i][held.reshape(plans.ctrls.shape[1:])])


@pytest.mark.parametrize(
    ("method", "slack"),
    [
        (trajopt.Shooting(optax.lbfgs(), iterations=100), 1e-4),
        (trajopt.Shooting(optax.adam(0.1), iterations=300), 1e-3),
        (trajopt.PredictiveSampling(iterations=300), 0.05),
        (trajopt.MPPI(iterations=300), 0.05),
        (trajopt.CEM(iterations=300, noise=1.0), 0.05),
    ],
    ids=lambda x: type(x).__name__ if not isinstance(x, float) else "",
)
def test_every_method_comes_near(method, slack):
    plan = trajopt.solve(linear.problem(), method)
    best = 0.5 * linear.START @ linear.riccati()[1] @ linear.START
    assert best * 0.9999 < plan.cost < best * (1 + slack)
    assert np.all(np.diff(plan.history[: int(plan.iterations)]) <= 0), "the best so far is kept"
    states, cost = linear.problem().rollout(plan.ctrls)
    np.testing.assert_allclose(states, plan.states, atol=1e-5)
    np.testing.assert_allclose(cost, plan.cost, rtol=1e-5)


@pytest.mark.slow
def test_control_by_planning_anew_is_the_plan(x64):
    """By Bellman's principle, where nothing disturbs and the horizon is long."""
    problem = linear.problem((-1.0, 1.0), horizon=80)
    plan = trajopt.solve(problem, trajopt.ILQR(tolerance=1e-12))
    track = trajopt.mpc(problem, trajopt.ILQR(), 10, plan.ctrls, first_iterations=3)
    np.testing.assert_allclose(track.ctrls, plan.ctrls[:10], atol=1e-3)
    np.testing.assert_allclose(track.states[:10], plan.states[:10], atol=1e-3)
