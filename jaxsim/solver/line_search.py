"""Exact line search on the piecewise smooth, convex objective.

Along `x + alpha s` the objective phi is convex, so its slope phi' increases and the minimum is the
root of phi'. The search takes Newton steps from alpha = 1 until phi' changes its sign. Then it
alternates between Newton steps and bisection. It evaluates the same points as MuJoCo in the same
order, so that with few iterations it ends at the same point.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays import tuning
from jaxsim.solver.operator import Lifted, Operator, Rows
from jaxsim.solver.problem import Problem


@struct.dataclass
class Line:
    """The objective along a line.

    Attributes:
        problem: The blocks of constraint rows.
        start: Residuals `J x - aref` at alpha = 0.
        direction: `J s`.
        descent: Minus the slope of the whole objective at alpha = 0.
        slope: Derivative of the quadratic term at alpha = 0, `s^T (M x - force)`.
        curvature: Its second derivative, `s^T M s`.
        rounding: Bound on the rounding error of a slope.
        cost_rounding: Bound on the rounding error of the objective.
    """

    problem: Problem
    start: Rows
    direction: Rows
    descent: Float[Array, ""]
    slope: Float[Array, ""]
    curvature: Float[Array, ""]
    rounding: Float[Array, ""]
    cost_rounding: Float[Array, ""]

    def slopes(self, alpha: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """phi'(alpha) and phi''(alpha)."""
        first, second = self.slope + alpha * self.curvature, self.curvature
        for block, r, v in self._blocks():
            d1, d2 = block.slopes(r + alpha * v, v)
            first, second = first + d1, second + d2
        return first, second

    def change(self, alpha: Float[Array, ""]) -> Float[Array, ""]:
        """phi(alpha) - phi(0)."""
        total = alpha * (self.slope + 0.5 * alpha * self.curvature)
        for block, r, v in self._blocks():
            total = total + block.change(r, alpha * v)
        return total

    def ends_at_one(self) -> Bool[Array, ""]:
        """Whether alpha = 1, the minimum of phi's quadratic model, is the minimum of phi.

        This is so if no row changes zone up to there and if the slope there is zero up to rounding.
        The slope is tested, because a step of an ill-conditioned Hessian may be inaccurate, and
        another one refines it, or even increase the objective.
        """
        quadratic = jnp.ones((), bool)
        for block, r, v in self._blocks():
            quadratic = quadratic & block.is_quadratic(r, r + v)
        first, second = self.slopes(jnp.ones_like(self.curvature))
        eps = jnp.finfo(first.dtype).eps
        left = 128 * eps * self.descent + self.rounding + 8 * eps * second
        return quadratic & (jnp.abs(first) <= left)

    def _blocks(self):
        return zip(self.problem.blocks, self.start, self.direction, strict=True)


def make_line(
    problem: Problem,
    operator: Operator,
    force: Float[Array, "nv"],
    residual: Float[Array, "nv"],
    y: Lifted,
    ys: Lifted,
) -> Line:
    """The objective along `y + alpha ys`; `residual` is minus its gradient at y."""
    rows, direction = operator.rows(y), operator.rows(ys)
    start = problem.residuals(rows)
    x, s = operator.vector(y), operator.vector(ys)
    given, unconstrained = force @ s, force - residual  # the latter is M x - J^T f
    inertial, cost = unconstrained @ s, unconstrained @ x  # s^T M x, x^T M x
    size = jnp.abs(given)
    for block, jx, r, v in zip(problem.blocks, rows, start, direction, strict=True):
        pushed = block.force(r)
        inertial, cost = inertial + jnp.sum(pushed * v), cost + jnp.sum(pushed * jx)
        size = size + jnp.sum(jnp.abs(pushed * v))
        cost = cost + jnp.sum(jnp.abs(pushed * r))
    size = size + jnp.abs(inertial)
    curvature = operator.inner(ys, ys)
    # Without a barrier XLA recomputes them for every use.
    inertial, given, curvature, size, cost = lax.optimization_barrier(
        (inertial, given, curvature, size, cost)
    )
    eps = jnp.finfo(size.dtype).eps
    return Line(
        problem=problem,
        start=start,
        direction=direction,
        descent=residual @ s,
        slope=inertial - given,
        curvature=curvature,
        rounding=8 * eps * size,
        cost_rounding=eps * cost,
    )


class _Search(NamedTuple):
    alpha: Float[Array, ""]  # the next point to evaluate; the result if done
    low: Float[Array, ""]  # the largest known point with a negative slope
    high: Float[Array, ""]  # the smallest known point with a positive slope
    middle: Float[Array, ""]  # bisection point to evaluate after the last Newton step, or inf
    done: Bool[Array, ""]
    count: Int[Array, ""]  # slopes that MuJoCo would have evaluated, including that at alpha = 0


def line_search(
    line: Line,
    tolerance: Float[Array, ""],
    iterations: int,
    done: bool | Bool[Array, ""] = False,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The step alpha >= 0 that minimises phi, and `phi(0) - phi(alpha)`.

    Args:
        line: The objective along a descent direction.
        tolerance: Slope below which a point is accepted.
        iterations: Largest number of slopes. The first is that at alpha = 0, which is known. The
            second is that at alpha = 1, the Newton step, which is always evaluated.
        done: If true, return the step 1 without a search. In a batch, this keeps environments
            whose solve has ended from prolonging the loop.

    Returns:
        The step and its improvement. The step is zero if nothing better than alpha = 0 was found.
    """
    one, zero = jnp.ones_like(line.curvature), jnp.zeros_like(line.curvature)
    inf = jnp.full_like(zero, jnp.inf)
    search = _Search(one, zero, inf, inf, jnp.asarray(done), jnp.ones((), int))
    iterations = max(iterations, 2)
    search = _repeat(lambda s: _advance(line, tolerance, s, iterations), search, iterations)
    # If iterations ran out, take the better of both ends; low is better than 0 by convexity.
    end = jnp.where(jnp.isfinite(search.high), search.high, search.low)
    end = jnp.where(search.done, search.alpha, end)
    changes = jax.vmap(line.change)(jnp.stack([end, search.low]))
    better = changes[0] <= changes[1] + line.rounding * end
    return jnp.where(better, end, search.low), -jnp.where(better, changes[0], changes[1])


def _repeat(advance: Callable[[_Search], _Search], search: _Search, iterations: int) -> _Search:
    if iterations > tuning.UNROLLED_EVALUATIONS:
        return lax.while_loop(lambda s: ~s.done & (s.count < iterations), advance, search)
    for _ in range(iterations - 1):
        search = advance(search)
    return search


def _advance(line: Line, tolerance: Float[Array, ""], search: _Search, iterations: int) -> _Search:
    """Evaluate the slope at the next point and choose the one after it."""
    alpha = search.alpha
    first, second = line.slopes(alpha)
    # Near the root of a stiff row the slope is the difference of two terms of size alpha phi''.
    rounding = line.rounding + 8 * jnp.finfo(alpha.dtype).eps * alpha * second
    low = jnp.where(first < 0, alpha, search.low)
    high = jnp.where(first > 0, alpha, search.high)
    newton, middle = alpha - first / jnp.where(second > 0, second, 1.0), 0.5 * (low + high)
    due = (search.middle > low) & (search.middle < high)
    proposal = jnp.where((newton > low) & (newton < high), newton, middle)
    proposal = jnp.where(due, search.middle, proposal)
    # A bisection point outside the bracket is skipped, but counted as in MuJoCo.
    count = search.count + 1 + (jnp.isfinite(search.middle) & ~due)
    # With a bracket, a Newton step and a bisection are evaluated as a pair, which needs two more
    # slopes: stop if fewer are left.
    pair = (low > 0) & jnp.isfinite(high) & ~due
    short = pair & (count + 2 > iterations)
    # Stop if the bracket has no number between its ends, or if the slope changes across it by less
    # than its accuracy, a fraction of the bound `rounding`.
    flat = (high - low) * second <= rounding / 8
    narrow = (proposal <= low) | (proposal >= high) | flat
    found = search.done | (jnp.abs(first) <= jnp.maximum(tolerance, rounding)) | narrow
    return _Search(
        alpha=jnp.where(found, alpha, jnp.where(short, high, proposal)),
        low=jnp.where(search.done, search.low, low),
        high=jnp.where(search.done, search.high, high),
        middle=jnp.where(pair, middle, jnp.inf),
        done=found | short,
        count=count,
    )
