"""Newton's method on the primal problem, with an exact line search.

The loop is MuJoCo's. It steps along `s = H^-1 (-gradient)` with the Hessian `H = M + J^T W J` of
the current zones, and stops when the scaled improvement or the scaled gradient is below the
tolerance. It starts from the warm start or the unconstrained point, whichever costs less, so that a
loop with few iterations also ends at the same point as MuJoCo's.

If no row changes zone along the full step, and the slope at its end is zero up to rounding, that
step ends at the minimum: there is no line search and the solve ends.

The Hessian may be one that sees the kink of friction coming, see `primal_dual`.

Two conditions are not MuJoCo's. A step that is not finite is rejected and ends the loop. And if a
step gains no more than rounding, the gradient no longer decreases and the next step promises
little, the loop ends whatever the tolerance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.solver import primal_dual
from jaxsim.solver.line_search import line_search, make_line
from jaxsim.solver.operator import Lifted, LinearStatus, Operator, Rows
from jaxsim.solver.problem import Problem

# A step that promises to gain more than this many rounding errors of the cost is worth a try.
PROMISING = 100.0
# Relative residual of the linear solves of an inexact loop: at most, and as a multiple of the
# square of the last step's gain (Eisenstat, Walker 1996, "Choosing the forcing terms in an inexact
# Newton method", choice 2).
_ROUGH, _FORCING = 0.1, 0.9
# They need not gain more than this part of the tolerance.
_SPARE = 1e-4


@struct.dataclass
class SolverStatus:
    """Status of a solve, in unscaled numbers.

    Attributes:
        iterations: Number of steps.
        residual: Norm of the gradient at the solution. Derivatives are exact if it is zero.
        improvement: Decrease of the cost by the last step; infinite without a step.
        cost: Objective at the solution.
        finite: False if a step was rejected because it was not finite.
        converged: Whether a stopping condition was met. False if the iterations ran out, or if a
            line search failed although the slope promised an improvement.
        linear: Combined status of the linear solves of all steps.
        passes: Number of passes for rigid rows, see `passes`; zero without them.
        rigid_residual: Change of the forces of those rows by another pass, relative to the largest
            force.
    """

    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    improvement: Float[Array, ""]
    cost: Float[Array, ""]
    finite: Bool[Array, ""]
    converged: Bool[Array, ""]
    linear: LinearStatus
    passes: Int[Array, ""] | np.int32 = np.int32(0)
    rigid_residual: Float[Array, ""] | np.float32 = np.float32(0)


@struct.dataclass
class Solution:
    """The minimiser.

    Attributes:
        x: The minimiser.
        status: Status of the solve.
    """

    x: Float[Array, "nv"]
    status: SolverStatus


class _Iterate(NamedTuple):
    y: Lifted
    gradient: Float[Array, ""]  # its norm at the start of the last step
    improvement: Float[Array, ""]
    exhausted: Bool[Array, ""]  # whether the last step gained only rounding
    count: Int[Array, ""]
    finite: Bool[Array, ""]
    done: Bool[Array, ""]
    converged: Bool[Array, ""]
    linear: LinearStatus
    directions: Rows | None  # of friction, for primal-dual steps


class _Search(NamedTuple):
    """The arguments of `solve` that are the same for all steps."""

    problem: Problem
    operator: Operator
    force: Float[Array, "nv"]
    ls_iterations: int
    tolerance: Float[Array, ""]
    ls_tolerance: Float[Array, ""]
    scale: Float[Array, ""]
    inexact: bool = False
    kinked: bool = False
    ls_reduction: float = 0.0
    enough: Float[Array, ""] | None = None  # gradient at which a solve ends without another step


def solve(
    problem: Problem,
    operator: Operator,
    force: Float[Array, "nv"],
    x_start: Float[Array, "nv"] | None,
    *,
    iterations: int,
    ls_iterations: int,
    tolerance: float | Float[Array, ""],
    ls_tolerance: float | Float[Array, ""],
    scale: float | Float[Array, ""],
    compare: bool = True,
    reduction: float = 0.0,
    inexact: bool = False,
    kinked: bool = False,
    ls_reduction: float = 0.0,
) -> Solution:
    """Minimise `1/2 x^T M x - force^T x + s(J x - aref)` over x.

    With `x_smooth = M^-1 force` this is `1/2 |x - x_smooth|_M^2 + s(J x - aref)` plus a constant.

    The result has no derivative; `implicit.attach` adds it.

    Args:
        problem: The blocks of constraint rows.
        operator: Mass matrix and Jacobian.
        force: Generalised forces other than constraint forces.
        x_start: Initial guess; zeros take its place if it is not finite, the unconstrained point if
            it is None.
        iterations: Largest number of Newton steps; if zero, the result is x_start.
        ls_iterations: Largest number of slopes in a line search, including that at its start.
        tolerance: Bound on the scaled improvement and on the scaled gradient norm.
        ls_tolerance: Line searches stop at a slope of `tolerance * ls_tolerance * |s| / scale`.
        scale: Factor that makes costs and gradients dimensionless: the inverse of the trace of M,
            or of its estimate `meaninertia * max(1, nv)`.
        compare: Whether to begin from the unconstrained point where that costs less than x_start.
        reduction: The loop also ends, not converged, where the gradient is this part of what it was
            at the start.
        inexact: Whether iterative linear solves need not be more accurate than the step is good.
        kinked: Whether many contacts stop or turn in a step, so that primal-dual steps pay.
        ls_reduction: Line searches also stop at a slope of this part of the first.

    Returns:
        The minimiser and the status of the solve.
    """
    numbers = [jnp.asarray(a, force.dtype) for a in (tolerance, ls_tolerance, scale)]
    held = (problem, operator, force, x_start, numbers)
    problem, operator, force, x_start, numbers = lax.stop_gradient(held)
    bound, ls_bound, scale = numbers
    options = (inexact, kinked, ls_reduction)
    search = _Search(problem, operator, force, ls_iterations, bound, ls_bound, scale, *options)
    start = _start(search, x_start, compare and iterations > 0)
    if reduction:
        search = search._replace(enough=reduction * _norm(_residual(search, start)))
    state = _run(search, start, iterations)
    status = SolverStatus(
        iterations=state.count,
        residual=_norm(_residual(search, state.y)),
        improvement=state.improvement,
        cost=_cost(search, state.y),
        finite=state.finite,
        converged=state.converged & state.finite,
        linear=state.linear,
    )
    return Solution(x=operator.vector(state.y), status=status)


def _start(search: _Search, x: Float[Array, "nv"] | None, compare: bool) -> Lifted:
    operator = search.operator
    if x is None:
        return operator.unconstrained(search.force)
    given = operator.lift(jnp.where(jnp.all(jnp.isfinite(x)), x, 0.0))
    if not compare:
        return given
    smooth = operator.unconstrained(search.force)
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), given, smooth)
    costs = jax.vmap(lambda y: _cost(search, y))(both)
    return _where(costs[1] < costs[0], smooth, given)


def _run(search: _Search, y: Lifted, iterations: int) -> _Iterate:
    inf = jnp.full_like(search.scale, jnp.inf)
    no, yes = jnp.zeros((), bool), jnp.ones((), bool)
    first = primal_dual.no_directions(search.problem) if search.kinked else None
    state = _Iterate(y, inf, inf, no, jnp.zeros((), jnp.int32), yes, no, no, LinearStatus(), first)
    if iterations == 0 or search.force.size == 0:
        return state._replace(finite=jnp.isfinite(_norm(_residual(search, y))))
    if iterations == 1:
        return _step(search, state)
    return lax.while_loop(
        lambda s: ~s.done & (s.count < iterations), lambda s: _step(search, s), state
    )


def _step(search: _Search, state: _Iterate) -> _Iterate:
    """One Newton step with its line search."""
    problem, operator = search.problem, search.operator
    residual = lax.optimization_barrier(_residual(search, state.y))
    gradient = _norm(residual)
    curvatures = _curvatures(search, state)
    ys, linear, rough = _newton_step(search, curvatures, residual, gradient, state.gradient)
    line = make_line(problem, operator, search.force, residual, state.y, ys)
    promise = 0.5 * jnp.abs(line.descent)
    # Steps that gained only rounding are the last, unless they halved the gradient or the next one
    # promises much more: in a corner between zones it takes short steps to find the right one.
    spent = state.exhausted & (gradient > 0.5 * state.gradient)
    spent = spent & ~(promise > PROMISING * line.cost_rounding)
    over = (search.scale * gradient <= search.tolerance) | spent
    length = _norm(operator.vector(ys))
    slope = search.tolerance * search.ls_tolerance * length / search.scale
    if search.ls_reduction:
        slope = jnp.maximum(slope, search.ls_reduction * line.descent)
    ends = line.ends_at_one() & ~rough
    found = line_search(line, slope, search.ls_iterations, state.done | over | ends)
    # Without barriers XLA recomputes these for every entry of the points.
    alpha, improvement = lax.optimization_barrier(found)
    finite = over | (jnp.isfinite(length) & jnp.isfinite(improvement))
    moved = lax.optimization_barrier(finite & (alpha > 0) & ~over)
    y = jax.tree.map(lambda a, b: a + alpha * b, state.y, ys)
    small = (search.scale * improvement < search.tolerance) & (improvement > 0)
    # A step promises half the slope. If that is rounding, a failed line search is convergence.
    stuck = ~moved & (promise <= line.cost_rounding)
    converged = over | small | stuck | ends
    y = _where(moved, y, state.y)
    done = ~moved | converged
    if search.enough is not None:
        done = done | (_norm(_residual(search, y)) <= search.enough)
    return _Iterate(
        y=y,
        gradient=gradient,
        improvement=jnp.where(moved, improvement, state.improvement),
        exhausted=jnp.maximum(improvement, state.improvement) <= line.cost_rounding,
        count=state.count + moved,
        finite=finite,
        done=done,
        converged=converged,
        linear=state.linear.then(linear),
        directions=_next_directions(search, state, ys),
    )


def _curvatures(search: _Search, state: _Iterate) -> Rows:
    rows = search.operator.rows(state.y)
    if state.directions is None:
        return search.problem.curvatures(rows)
    return primal_dual.curvatures(search.problem, rows, state.directions)


def _next_directions(search: _Search, state: _Iterate, ys: Lifted) -> Rows | None:
    if state.directions is None:
        return None
    rows, steps = search.operator.rows(state.y), search.operator.rows(ys)
    return primal_dual.next_directions(search.problem, rows, steps, state.directions)


def _newton_step(search: _Search, curvatures: Rows, residual, gradient, before):
    """The step `H^-1 residual`, the status of that solve, and whether it is a rough one.

    A loop that is inexact solves roughly while its steps do not lower the gradient much, and never
    more accurately than its tolerance deserves.
    """
    if not search.inexact:
        return *search.operator.solve(curvatures, residual), jnp.zeros((), bool)
    gain = jnp.where(jnp.isfinite(before), gradient / before, 1.0)
    enough = jnp.minimum(_FORCING * gain * gain, _ROUGH)
    rough = enough > jnp.sqrt(jnp.finfo(gradient.dtype).eps)
    enough = jnp.where(rough, enough, 0.0)
    spare = _SPARE * search.tolerance / search.scale
    found = search.operator.solve(curvatures, residual, enough, spare)
    return *found, rough


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
