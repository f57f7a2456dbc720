"""Least squares with known minima."""

import jax
import jax.numpy as jnp
import numpy as np
from oracle import quick_jit

from jaxsim.solver.levenberg_marquardt import LeastSquares, damped_step, minimise


def problem_of(residual):
    """Dense least squares of a function of one vector."""

    def evaluate(x):
        r, J = residual(x), jax.jacfwd(residual)(x)
        return 0.5 * r @ r, (J.T @ J, J.T @ r)

    return LeastSquares(evaluate, lambda normal, lam: damped_step(*normal, lam), jnp.add)


def rosenbrock(x):
    """The banana valley; its minimum is at (1, 1). The last number does not matter."""
    return jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def test_a_curved_valley(x64):
    starts = jnp.array([[-1.2, 1.0, 5.0], [5.0, -3.0, 5.0], [1.0, 1.0, 5.0]])
    run = lambda x: minimise(problem_of(rosenbrock), x, iterations=100, tolerance=1e-12)  # noqa: E731
    found = quick_jit(jax.vmap(run))(starts)
    np.testing.assert_allclose(found.x, [[1, 1, 5]] * 3, atol=1e-6)
    assert found.converged.all()
    assert (found.count < 60).all()


def test_a_residual_that_stays(x64):
    """A line through three points; the exact answer is that of linear least squares."""
    A, b = jnp.array([[1.0, 0], [1, 1], [1, 2]]), jnp.array([0.0, 1, 5])
    run = lambda x: minimise(problem_of(lambda x: A @ x - b), x, iterations=50, tolerance=1e-14)  # noqa: E731
    found = quick_jit(run)(jnp.zeros(2))
    np.testing.assert_allclose(found.x, np.linalg.lstsq(A, b)[0], atol=1e-6)
    np.testing.assert_allclose(found.cost, 0.75, rtol=1e-12)


def test_what_is_not_finite_is_not_taken(x64):
    """A logarithm beyond whose end there is nothing, and a start from which there is no way."""
    run = lambda x: minimise(  # noqa: E731
        problem_of(lambda x: jnp.log(x) + 3), x, iterations=200, tolerance=1e-12
    )
    found = quick_jit(jax.vmap(run))(jnp.array([[2.0], [-1.0]]))
    np.testing.assert_allclose(found.x[0], np.exp(-3), rtol=1e-5)
    assert found.converged[0]
    assert found.stuck[1]
    assert np.isinf(found.cost[1])
