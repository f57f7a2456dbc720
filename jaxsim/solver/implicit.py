"""Implicit derivatives of the solution with respect to the problem.

At the minimum the residual, which is minus the gradient of the objective, is zero:
`r(x, theta) = 0`. By the implicit function theorem

    dx = H^-1 (dr/dtheta) dtheta,    H = -dr/dx = M + J^T W J,

whatever method found x. The derivative needs one more linear solve, which is done only if the
function is differentiated. It is exact if the solve has converged, see `SolverStatus.residual`.
"""

from collections.abc import Sequence

import jax
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import SOLUTION
from jaxsim.arrays.precision import full_precision
from jaxsim.batching.primitives.jvp_rule import moving_leaves, with_jvp_rule
from jaxsim.solver.conjugate_gradients import hessian_product
from jaxsim.solver.operator import Lifted, Operator, Rows
from jaxsim.solver.problem import Problem

Theta = tuple[Problem, Operator, Float[Array, "nv"]]
"""The problem's parameters: blocks of rows, operator, force."""


def attach(
    x: Float[Array, "nv"], problem: Problem, operator: Operator, force: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """`attach_lifted`, returning the point x only."""
    return operator.vector(attach_lifted(x, problem, operator, force))


def attach_lifted(
    x: Float[Array, "nv"], problem: Problem, operator: Operator, force: Float[Array, "nv"]
) -> Lifted:
    """Return the minimiser, lifted, as a differentiable function of the problem.

    Forward and reverse mode, `vmap` and `jit` apply, and so do second derivatives except at the
    boundaries of the cost's zones. The computation of x is not differentiated. A backward pass
    with rematerialisation that has stored x does not solve again, see `jaxsim.checkpoint`.

    Args:
        x: The minimiser.
        problem: The blocks of constraint rows.
        operator: Mass matrix and Jacobian.
        force: Generalised forces other than constraint forces.

    Returns:
        The lifted x as a function of problem, operator and force.
    """
    y = operator.lift(checkpoint_name(jax.lax.stop_gradient(x), SOLUTION))
    return _attached(jax.lax.stop_gradient(y), (problem, operator, force))


def _attached(y: Lifted, theta: Theta) -> Lifted:
    """The lifted point y with its derivative with respect to theta."""
    leaves, structure = jax.tree.flatten((y, theta))
    count = len(jax.tree.leaves(y))

    @full_precision
    def rule(primals, tangents):
        found, theta = structure.unflatten(primals)
        # y depends on theta here, too, so that the rule itself can be differentiated.
        y = _attached(found, theta)
        return jax.tree.leaves(y), jax.tree.leaves(_tangent(y, theta, tangents[count:]))

    same = with_jvp_rule(lambda *xs: xs[:count], rule)(*leaves)
    return jax.tree.unflatten(jax.tree.structure(y), same)


def _tangent(y: Lifted, theta: Theta, tangents: Sequence[Array | None]) -> Lifted:
    """The minimiser's tangent for tangents of some leaves of theta; None for the others."""
    problem, operator, _ = theta
    moved, given, where = moving_leaves(theta, tangents)
    x = operator.vector(y)
    _, dr = jax.jvp(lambda *some: _residual(x, where(*some)), moved, given)
    dx = solve_hessian(operator, problem.curvatures(operator.rows(y)), dr)
    # The lift depends on theta, too.
    lift = lambda x, *some: where(*some)[1].lift(x)  # noqa: E731
    return jax.jvp(lift, [x, *moved], [dx, *given])[1]


def solve_hessian(
    operator: Operator, curvatures: Rows, r: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """`H^-1 r`; its derivatives use solves and products, not the steps of the operator's solve."""
    return lax.custom_linear_solve(
        lambda x: hessian_product(operator, curvatures, x),
        r,
        lambda _, r: operator.vector(operator.solve(curvatures, r)[0]),
        symmetric=True,
    )


def _residual(x: Float[Array, "nv"], theta: Theta) -> Float[Array, "nv"]:
    problem, operator, force = theta
    y = operator.lift(x)
    return force + operator.residual(y, problem.forces(operator.rows(y)))
