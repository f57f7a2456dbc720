"""Limits on states: against a quadratic program, and for a cart with a short track."""

import jax.numpy as jnp
import linear
import numpy as np
import pytest
import scipy.optimize

from jaxsim import trajopt
from jaxsim.lanes import switch
from jaxsim.trajopt.tasks import TASKS

LEAST = -0.15  # of the first number of the state


def below(x):
    return jnp.array([LEAST - x[0]])


def test_a_linear_system_stays_within_limits(x64):
    """The optimum is that of a quadratic program in the controls."""
    problem = linear.problem().replace(state_limits=below)
    free = trajopt.solve(linear.problem(), trajopt.ILQR())
    method = trajopt.AugmentedLagrangian(trajopt.ILQR(tolerance=1e-12), tolerance=1e-8)
    plan = trajopt.solve(problem, method)
    assert plan.status == trajopt.PlanStatus.CONVERGED
    assert free.states[:, 0].min() < LEAST - 0.05, "the example needs the limit"
    assert plan.states[1:, 0].min() > LEAST - 1e-8
    assert plan.defect <= 1e-8
    m, c = linear.least_squares()
    first = np.array([np.linalg.matrix_power(linear.A, t)[0] for t in range(linear.HORIZON + 1)])
    reach = np.zeros((linear.HORIZON, 2 * linear.HORIZON))
    for t in range(linear.HORIZON):
        for s in range(t + 1):
            reach[t, 2 * s : 2 * s + 2] = first[t - s] @ linear.B
    best = scipy.optimize.minimize(
        lambda u: 0.5 * np.sum((m @ u + c) ** 2),
        np.ravel(plan.ctrls) * 0,
        jac=lambda u: m.T @ (m @ u + c),
        method="SLSQP",
        constraints={
            "type": "ineq",
            "fun": lambda u: reach @ u + first[1:] @ linear.START - LEAST,
            "jac": lambda u: reach,
        },
        options={"ftol": 1e-14, "maxiter": 500},
    )
    unevaluated = 0.5 * linear.START @ linear.Q @ linear.START  # what no control can change
    np.testing.assert_allclose(plan.cost, best.fun + unevaluated, rtol=1e-7)
    np.testing.assert_allclose(np.ravel(plan.ctrls), best.x, atol=1e-4)


@pytest.mark.slow
def test_a_cart_with_a_short_track(monkeypatch):
    """Without the limit the cart goes 0.74 m to either side to swing its pole up."""
    pytest.importorskip("llvmlite")
    monkeypatch.setattr(switch, "_enabled", True)
    task = TASKS["cartpole"]
    problem = task.make().replace(state_limits=lambda x: jnp.abs(x.qpos[:1]) - 0.55)
    plan = trajopt.solve(problem, trajopt.AugmentedLagrangian(task.method), starts=4)
    assert plan.status == trajopt.PlanStatus.CONVERGED
    assert 0.54 < np.abs(plan.states.qpos[:, 0]).max() <= 0.551
    assert task.distance(problem, plan) <= task.goal


def test_what_is_refused():
    arguments = {"horizon": 5, "running_cost": lambda x, u, t: x @ x, "nu": 2}
    with pytest.raises(trajopt.ProblemError, match=r"array \(m,\), got float32\[\]"):
        trajopt.make_problem(
            lambda x, u: x + u.sum(), jnp.zeros(3), state_limits=lambda x: x[0], **arguments
        )
    problem = linear.problem().replace(state_limits=below)
    with pytest.raises(trajopt.ProblemError, match="AugmentedLagrangian"):
        trajopt.solve(problem, trajopt.ILQR())
    with pytest.raises(trajopt.ProblemError, match="a problem with state_limits"):
        trajopt.solve(linear.problem(), trajopt.AugmentedLagrangian(trajopt.ILQR()))
