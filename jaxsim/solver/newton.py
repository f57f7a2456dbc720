"""Newton's method on the primal problem, with an exact line search.

The loop is MuJoCo's: step along `s = H^-1 (-gradient)` with the Hessian `H = M + J^T W J` of the
current zones, stop when the scaled improvement or the scaled gradient falls below the tolerance.
It starts at the warm start. MuJoCo takes the unconstrained point instead where that costs less, for
which it must be known, at the price of another solve; without active rows one step ends there.
Two things are added. A step that is not finite is refused and ends the loop. And when a step gains
no more than rounding and the gradient no longer shrinks, the loop ends whatever the tolerance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.solver.line_search import line_search, make_line
from jaxsim.solver.operator import Lifted, Operator, Rows
from jaxsim.solver.problem import Problem


@struct.dataclass
class SolverStatus:
    """How the solve went. Nothing here is scaled.

    Attributes:
        iterations: Steps taken.
        residual: Norm of the gradient at the solution. Derivatives are exact where it is zero.
        improvement: Decrease of the cost by the last step; infinite without a step.
        cost: Objective at the solution.
        finite: False if a step was refused because it was not finite.
    """

    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    improvement: Float[Array, ""]
    cost: Float[Array, ""]
    finite: Bool[Array, ""]


@struct.dataclass
class Solution:
    """The minimiser.

    Attributes:
        x: The point.
        status: How the solve went.
    """

    x: Float[Array, "nv"]
    status: SolverStatus


class _Iterate(NamedTuple):
    y: Lifted
    residual: Float[Array, "nv"]
    improvement: Float[Array, ""]
    count: Int[Array, ""]
    finite: Bool[Array, ""]
    done: Bool[Array, ""]


class _Search(NamedTuple):
    """What stays the same from step to step."""

    problem: Problem
    operator: Operator
    force: Float[Array, "nv"]
    ls_iterations: int
    tolerance: Float[Array, ""]
    ls_tolerance: Float[Array, ""]
    scale: Float[Array, ""]


def solve(
    problem: Problem,
    operator: Operator,
    force: Float[Array, "nv"],
    x_start: Float[Array, "nv"],
    *,
    iterations: int,
    ls_iterations: int,
    tolerance: float | Float[Array, ""],
    ls_tolerance: float | Float[Array, ""],
    scale: float | Float[Array, ""],
) -> Solution:
    """Minimises `1/2 x^T M x - force^T x + s(J x - aref)` over x.

    With `x_smooth = M^-1 force` that is `1/2 |x - x_smooth|_M^2 + s(J x - aref)` and a constant.

    The result carries no derivative; `implicit.attach` gives it one.

    Args:
        problem: The blocks of constraint rows.
        operator: Mass matrix and Jacobian.
        force: All forces but those of constraints.
        x_start: Where to begin; zeros if it is not finite.
        iterations: Largest number of Newton steps. With 1 there is no loop.
        ls_iterations: Largest number of slopes that a line search evaluates.
        tolerance: Bound on the scaled improvement and on the scaled gradient norm.
        ls_tolerance: Line searches stop at a slope of `tolerance * ls_tolerance * |s| / scale`.
        scale: Makes costs and gradients dimensionless: the inverse of the trace of M, or of
            `meaninertia * max(1, nv)`, an estimate of it.

    Returns:
        The minimiser and how it was found.
    """
    numbers = [jnp.asarray(a, force.dtype) for a in (tolerance, ls_tolerance, scale)]
    held = (problem, operator, force, x_start, numbers)
    problem, operator, force, x_start, numbers = lax.stop_gradient(held)
    search = _Search(problem, operator, force, ls_iterations, *numbers)
    x = jnp.where(jnp.all(jnp.isfinite(x_start)), x_start, 0.0)
    state = _run(search, _start(search, operator.lift(x)), iterations)
    status = SolverStatus(
        iterations=state.count,
        residual=_norm(_residual(search, state.y)),
        improvement=state.improvement,
        cost=_cost(search, state.y),
        finite=state.finite,
    )
    return Solution(x=operator.vector(state.y), status=status)


def _run(search: _Search, state: _Iterate, iterations: int) -> _Iterate:
    if iterations == 0 or state.residual.size == 0:
        return state
    if iterations == 1:
        return _step(search, state)
    return lax.while_loop(
        lambda s: ~s.done & (s.count < iterations), lambda s: _step(search, s), state
    )


def _start(search: _Search, y: Lifted) -> _Iterate:
    residual = _residual(search, y)
    return _Iterate(
        y=y,
        residual=residual,
        improvement=jnp.full_like(search.scale, jnp.inf),
        count=jnp.zeros((), jnp.int32),
        finite=jnp.ones((), bool),
        done=search.scale * _norm(residual) <= search.tolerance,
    )


def _step(search: _Search, state: _Iterate) -> _Iterate:
    """One Newton step with its line search."""
    problem, operator = search.problem, search.operator
    curvatures = problem.curvatures(operator.rows(state.y))
    ys = operator.solve(curvatures, state.residual)
    line = make_line(problem, operator, search.force, state.y, ys)
    length = _norm(operator.vector(ys))
    slope = search.tolerance * search.ls_tolerance * length / search.scale
    alpha, improvement = line_search(line, slope, search.ls_iterations, state.done)
    y = jax.tree.map(lambda a, b: a + alpha * b, state.y, ys)
    residual = _residual(search, y)
    # Nothing that only a further step needs is looked at here: with a single step the compiler
    # then leaves the new residual out.
    finite = jnp.isfinite(length) & jnp.isfinite(improvement)
    moved = finite & (alpha > 0)
    stop = _converged(search, residual, improvement) | ~jnp.isfinite(_norm(residual))
    stop = stop | _exhausted(state, residual, improvement, line.cost_rounding)
    stop = stop | _exact(alpha, curvatures, problem.curvatures(operator.rows(y)))
    return _Iterate(
        y=_where(moved, y, state.y),
        residual=jnp.where(moved, residual, state.residual),
        improvement=jnp.where(moved, improvement, 0.0),
        count=state.count + moved,
        finite=finite,
        done=stop | ~moved,
    )


def _converged(search: _Search, residual: Array, improvement: Array) -> Bool[Array, ""]:
    """Whether the improvement or the gradient is below the tolerance."""
    gradient = search.scale * _norm(residual)
    small = search.scale * improvement < search.tolerance
    return (small & (improvement > 0)) | (gradient <= search.tolerance)


def _exhausted(
    state: _Iterate, residual: Array, improvement: Array, rounding: Array
) -> Bool[Array, ""]:
    """Whether only rounding is left: two steps in a row gained no more than that.

    A step that still converges is told apart by the gradient, which it shrinks far more.
    """
    gained = jnp.maximum(improvement, state.improvement)
    return (gained <= rounding) & (_norm(residual) > 0.5 * _norm(state.residual))


def _exact(alpha: Array, before: Rows, after: Rows) -> Bool[Array, ""]:
    """Whether the objective was its quadratic model along a full step, whose end is the minimum.

    Rows with piecewise constant curvature change zone at most once along a line.
    """
    exact = jnp.abs(alpha - 1) <= 64 * jnp.finfo(alpha.dtype).eps
    for a, b in zip(before, after, strict=True):
        exact = exact & jnp.all(a == b)
    return exact


def _residual(search: _Search, y: Lifted) -> Float[Array, "nv"]:
    forces = search.problem.forces(search.operator.rows(y))
    return search.force + search.operator.residual(y, forces)


def _cost(search: _Search, y: Lifted) -> Float[Array, ""]:
    quadratic = 0.5 * search.operator.inner(y, y) - search.force @ search.operator.vector(y)
    return quadratic + search.problem.cost(search.operator.rows(y))


def _where(condition: Bool[Array, ""], a: Lifted, b: Lifted) -> Lifted:
    return jax.tree.map(lambda x, y: jnp.where(condition, x, y), a, b)


def _norm(x: Float[Array, "n"]) -> Float[Array, ""]:
    return jnp.sqrt(jnp.sum(x * x))
