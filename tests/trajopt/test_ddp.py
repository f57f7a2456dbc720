"""DDP is Newton's method: it ends faster than iLQR where dynamics are curved."""

import jax.numpy as jnp
import linear
import numpy as np
import pytest

from jaxsim import trajopt


def swing_up(limit):
    """A pendulum by explicit formulas, which swings up in three seconds."""

    def step(x, u):
        rate = x[1] + 0.05 * (9.8 * jnp.sin(x[0]) + u[0])
        return jnp.stack([x[0] + 0.05 * rate, rate])

    return trajopt.make_problem(
        step,
        jnp.array([3.0, 0.0]),
        horizon=60,
        running_cost=lambda x, u, t: 0.1 * (1 - jnp.cos(x[0])) + 0.01 * u @ u,
        final_cost=lambda x: 20 * (1 - jnp.cos(x[0])) + x[1] ** 2,
        nu=1,
        control_limits=(-limit, limit),
    )


@pytest.mark.parametrize("limit", [jnp.inf, 5.0])
def test_the_end_is_quadratic(x64, limit):
    problem = swing_up(limit)
    plan = trajopt.solve(problem, trajopt.DDP(tolerance=1e-14))
    slow = trajopt.solve(problem, trajopt.ILQR(tolerance=1e-14))
    assert plan.status == slow.status == trajopt.PlanStatus.CONVERGED
    np.testing.assert_allclose(plan.cost, slow.cost, rtol=1e-12)
    np.testing.assert_allclose(plan.ctrls, slow.ctrls, atol=1e-5)
    assert plan.iterations < 0.3 * slow.iterations
    held = np.abs(plan.ctrls) == limit
    assert held.any() == np.isfinite(limit)
    # The cost is above the least by the square of the error, which is squared each time itself.
    excess = np.asarray(plan.history[: int(plan.iterations)] - plan.cost)
    excess = excess[(excess > 1e-11) & (excess < 0.01)]
    assert len(excess) >= 2
    assert np.all(excess[1:] < 0.3 * excess[:-1] ** 1.3)


def test_linear_dynamics_have_no_curvature(x64):
    plan = trajopt.solve(linear.problem(), trajopt.DDP(damping=0.0, tolerance=1e-13))
    assert plan.iterations == 2, "the guess, and one step"
    np.testing.assert_allclose(plan.gains, linear.riccati()[0], atol=1e-8)
