"""The solution as a differentiable function of the problem.

At the minimum the residual, minus the gradient of the objective, is zero: `r(x, theta) = 0`. By
the implicit function theorem

    dx = H^-1 (dr/dtheta) dtheta,    H = -dr/dx = M + J^T W J,

whatever loop found x. The derivative is one further linear solve, taken only when somebody
differentiates, and is exact as far as the loop converged: look at `SolverStatus.residual`.
"""

import jax
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import SOLUTION
from jaxsim.arrays.precision import full_precision
from jaxsim.solver.conjugate_gradients import hessian_product
from jaxsim.solver.operator import Lifted, Operator, Rows
from jaxsim.solver.problem import Problem


def attach(
    x: Float[Array, "nv"], problem: Problem, operator: Operator, force: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """`attach_lifted` without what the lift adds."""
    return operator.vector(attach_lifted(x, problem, operator, force))


def attach_lifted(
    x: Float[Array, "nv"], problem: Problem, operator: Operator, force: Float[Array, "nv"]
) -> Lifted:
    """Returns the minimiser unchanged, lifted, with its derivatives.

    Forward and reverse mode, `vmap` and `jit` apply, and so do second derivatives away from the
    boundaries of the cost's zones. Nothing flows back into how x was found, and nothing but x is
    needed of it: a backward pass that recomputes what it needs does not solve again where x was
    kept, see `jaxsim.checkpoint`.

    Args:
        x: The minimiser.
        problem: The blocks of constraint rows.
        operator: Mass matrix and Jacobian.
        force: All forces but those of constraints.

    Returns:
        The lifted x as a function of problem, operator and force.
    """
    y = operator.lift(checkpoint_name(jax.lax.stop_gradient(x), SOLUTION))
    return _attached(jax.lax.stop_gradient(y), (problem, operator, force))


@jax.custom_jvp
def _attached(y, theta):
    del theta
    return y


@_attached.defjvp
@full_precision
def _attached_jvp(primals, tangents):
    found, theta = primals
    problem, operator, _ = theta
    # The point is again a function of theta, which makes the rule itself differentiable.
    y = _attached(found, theta)
    x = operator.vector(y)
    _, dr = jax.jvp(lambda t: _residual(x, t), (theta,), (tangents[1],))
    dx = _solve(operator, problem.curvatures(operator.rows(y)), dr)
    # Lifting depends on theta too.
    _, dy = jax.jvp(lambda op, x: op.lift(x), (operator, x), (tangents[1][1], dx))
    return y, dy


def _solve(operator: Operator, curvatures: Rows, r: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """`H^-1 r`. Its derivatives are solves and products, whatever the operator does for a solve."""
    return lax.custom_linear_solve(
        lambda x: hessian_product(operator, curvatures, x),
        r,
        lambda _, r: operator.vector(operator.solve(curvatures, r)[0]),
        symmetric=True,
    )


def _residual(x, theta):
    problem, operator, force = theta
    y = operator.lift(x)
    return force + operator.residual(y, problem.forces(operator.rows(y)))
