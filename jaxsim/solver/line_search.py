"""Exact line search on the piecewise smooth, convex objective.

Along `x + alpha s` the objective phi is convex, so its slope phi' increases and the minimum is
its only root: Newton steps on phi' from alpha = 1 until its sign changes, then Newton steps and
middles of the bracket by turns. These are MuJoCo's points in MuJoCo's order, so that a search that
few evaluations cut short ends where MuJoCo's does.
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
        bend: Its second derivative, `s^T M s`.
        rounding: What rounding may add to a slope.
        cost_rounding: What rounding may add to the objective.
    """

    problem: Problem
    start: Rows
    direction: Rows
    descent: Float[Array, ""]
    slope: Float[Array, ""]
    bend: Float[Array, ""]
    rounding: Float[Array, ""]
    cost_rounding: Float[Array, ""]

    def slopes(self, alpha: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """phi'(alpha) and phi''(alpha)."""
        first, second = self.slope + alpha * self.bend, self.bend
        for block, r, v in self._blocks():
            d1, d2 = block.slopes(r + alpha * v, v)
            first, second = first + d1, second + d2
        return first, second

    def change(self, alpha: Float[Array, ""]) -> Float[Array, ""]:
        """phi(alpha) - phi(0)."""
        total = alpha * (self.slope + 0.5 * alpha * self.bend)
        for block, r, v in self._blocks():
            total = total + block.change(r, alpha * v)
        return total

    def ends_at_one(self) -> Bool[Array, ""]:
        """Whether alpha = 1, the minimum of phi's quadratic model, is that of phi.

        No row changes zone on the way, and the slope there is what rounding may leave: what is
        still to be gained is rounding beside what was gained. Of an ill-conditioned step, which
        may not even go down, only the first is true.
        """
        quadratic = jnp.ones((), bool)
        for block, r, v in self._blocks():
            quadratic = quadratic & block.is_quadratic(r, r + v)
        first, second = self.slopes(jnp.ones_like(self.bend))
        eps = jnp.finfo(first.dtype).eps
        left = jnp.sqrt(eps) * self.descent + self.rounding + 8 * eps * second
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
    """The objective from y, where minus its gradient is the residual, along ys."""
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
    bend = operator.inner(ys, ys)
    # Without a barrier they would be computed again for every number that depends on them.
    inertial, given, bend, size, cost = lax.optimization_barrier(
        (inertial, given, bend, size, cost)
    )
    eps = jnp.finfo(size.dtype).eps
    return Line(
        problem=problem,
        start=start,
        direction=direction,
        descent=residual @ s,
        slope=inertial - given,
        bend=bend,
        rounding=8 * eps * size,
        cost_rounding=eps * cost,
    )


class _Search(NamedTuple):
    alpha: Float[Array, ""]  # the next point to try; once done, the result
    low: Float[Array, ""]  # the largest known point with a negative slope
    high: Float[Array, ""]  # the smallest known point with a positive slope
    middle: Float[Array, ""]  # of the bracket before the last Newton step, due after it, or inf
    done: Bool[Array, ""]
    count: Int[Array, ""]  # slopes that MuJoCo would have evaluated, that at alpha = 0 included


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
        iterations: Largest number of slopes. The first is that at alpha = 0, which is known; the
            second, at alpha = 1, the Newton step, is evaluated in any case.
        done: True asks for the step 1, without a search. In a batch, environments whose solve has
            ended go along with the others, and should not keep them waiting.

    Returns:
        The step and its improvement. The step is zero if nothing better than alpha = 0 was found.
    """
    one, zero = jnp.ones_like(line.bend), jnp.zeros_like(line.bend)
    inf = jnp.full_like(zero, jnp.inf)
    search = _Search(one, zero, inf, inf, jnp.asarray(done), jnp.ones((), int))
    iterations = max(iterations, 2)
    search = _repeat(lambda s: _advance(line, tolerance, s, iterations), search, iterations)
    # Where the search was cut short, the cheaper of two ends; low improves by convexity.
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
    """Evaluates the slope at the next point and chooses the one after it."""
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
    # A middle outside the bracket is passed over, but counts.
    count = search.count + 1 + (jnp.isfinite(search.middle) & ~due)
    # A turn in a bracket takes two slopes. It is not begun where only one is left.
    turn = (low > 0) & jnp.isfinite(high) & ~due
    short = turn & (count + 2 > iterations)
    # Nothing lies between the ends of a bracket as narrow as a unit of rounding, and nothing is
    # to be gained in one along which the slope changes by less than it can be known: a fraction
    # of `rounding`, which is a bound.
    flat = (high - low) * second <= rounding / 8
    narrow = (proposal <= low) | (proposal >= high) | flat
    found = search.done | (jnp.abs(first) <= jnp.maximum(tolerance, rounding)) | narrow
    return _Search(
        alpha=jnp.where(found, alpha, jnp.where(short, high, proposal)),
        low=jnp.where(search.done, search.low, low),
        high=jnp.where(search.done, search.high, high),
        middle=jnp.where(turn, middle, jnp.inf),
        done=found | short,
        count=count,
    )
