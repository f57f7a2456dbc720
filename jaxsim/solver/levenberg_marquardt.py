"""Levenberg-Marquardt: nonlinear least squares over points of any kind.

The cost is `1/2 |r(x)|^2`. A step dx solves

    (J^T J + lambda D) dx = -J^T r,    D the diagonal of J^T J,

which is the Gauss-Newton step for small damping lambda and a short descent step for a large one.
The damping is adapted to the ratio of the actual and the predicted decrease of the cost (Nielsen
1999, "Damping parameter in Marquardt's method"). The problem supplies the linear solve, so that it
can use its structure. The loop is compiled, has a fixed bound and may be batched.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.batching.matrices import cholesky, cholesky_solve

_FIRST_DAMPING = 1e-3
_STUCK = 1e8  # damping above which no step reduces the cost
_RELATIVE_FLOOR = 1e-8  # relative floor of D, for parameters without effect on the residual

Point = Any
Normal = Any


class LeastSquares(NamedTuple):
    """A nonlinear least-squares problem.

    Attributes:
        evaluate: From a point to its cost and its normal equations, in any form.
        solve: From normal equations and a damping to a step and the predicted decrease of cost.
        move: From a point and a step to the next point.
    """

    evaluate: Callable[[Point], tuple[Float[Array, ""], Normal]]
    solve: Callable[[Normal, Float[Array, ""]], tuple[Any, Float[Array, ""]]]
    move: Callable[[Point, Any], Point]


@struct.dataclass
class Iterate:
    """State of a minimisation.

    Attributes:
        x: The best point so far.
        cost: Its cost.
        normal: Its normal equations, from `LeastSquares.evaluate`.
        damping: Lambda of the next step.
        growth: Factor of the damping if the next step fails.
        count: Number of evaluations.
        converged: Whether the predicted decrease is below the tolerance.
        stuck: Whether no step reduces the cost, however large the damping.
    """

    x: Point
    cost: Float[Array, ""]
    normal: Normal
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    count: Int[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]

    @property
    def done(self) -> Bool[Array, ""]:
        """Whether the minimisation has ended."""
        return self.converged | self.stuck


def minimise(problem: LeastSquares, x: Point, *, iterations: int, tolerance: float) -> Iterate:
    """Minimise the cost from an initial point.

    Args:
        problem: The problem.
        x: The initial point.
        iterations: Largest number of evaluations.
        tolerance: Predicted relative decrease of the cost at which the loop ends.
    """
    return lax.while_loop(
        lambda now: ~now.done & (now.count < iterations),
        lambda now: advance(problem, now, tolerance),
        begin(problem, x),
    )


def begin(problem: LeastSquares, x: Point) -> Iterate:
    """The iterate before the first evaluation: its cost is infinite."""
    shapes = jax.eval_shape(problem.evaluate, x)
    cost, normal = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    count, no = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    now = Iterate(x, cost, normal, cost, cost, count, no, no)
    return restart(now, x)


def restart(now: Iterate, x: Point) -> Iterate:
    """The iterate before the first evaluation at another point, with the count so far."""
    no, one = jnp.zeros((), bool), jnp.ones_like(now.cost)
    return now.replace(
        x=x,
        cost=jnp.inf * one,
        damping=_FIRST_DAMPING * one,
        growth=2 * one,
        converged=no,
        stuck=no,
    )


def advance(problem: LeastSquares, now: Iterate, tolerance: float) -> Iterate:
    """The iterate after one more step and evaluation."""
    fresh = jnp.isinf(now.cost)
    step, promised = problem.solve(now.normal, now.damping)
    promised = jnp.where(fresh, 1.0, promised)
    choose = lambda a, b: jnp.where(fresh, a, b)  # noqa: E731
    trial = jax.tree.map(choose, now.x, problem.move(now.x, step))
    return _judge(now, trial, promised, *problem.evaluate(trial), tolerance)


def _judge(now: Iterate, trial: Point, promised, cost, normal, tolerance: float) -> Iterate:
    """Accept the trial point if its cost is lower, and adapt the damping."""
    better = cost < now.cost  # not if it is NaN
    tiny = jnp.finfo(cost.dtype).tiny
    gain = jnp.clip((now.cost - cost) / jnp.maximum(promised, tiny), 0.0, 2.0)
    shrink = jnp.maximum(1 / 3, 1 - (2 * gain - 1) ** 3)
    damping = now.damping * jnp.where(better, shrink, now.growth)
    # Predicted decrease of a step without damping, if D were J^T J.
    whole = promised * (1 + now.damping)
    least = max(tolerance, 8 * float(jnp.finfo(cost.dtype).eps))
    converged = jnp.isfinite(now.cost) & (whole <= least * now.cost)
    keep = lambda new, old: jnp.where(better, new, old)  # noqa: E731
    return Iterate(
        x=jax.tree.map(keep, trial, now.x),
        cost=keep(cost, now.cost),
        normal=jax.tree.map(keep, normal, now.normal),
        damping=damping,
        growth=jnp.where(better, 2.0, 2 * now.growth).astype(cost.dtype),
        count=now.count + 1,
        converged=converged,
        stuck=~converged & (damping > _STUCK),
    )


def damped_step(
    H: Float[Array, "n n"], g: Float[Array, "n"], damping: Float[Array, ""]
) -> tuple[Float[Array, "n"], Float[Array, ""]]:
    """The step of a dense problem, and its predicted decrease `-(g dx + 1/2 dx H dx)`.

    Args:
        H: `J^T J`.
        g: `J^T r`.
        damping: Lambda.
    """
    diagonal = damped_diagonal(H, damping)
    step = cholesky_solve(cholesky(H + jnp.diag(diagonal)), -g)
    return step, promise(g, step, diagonal)


def damped_diagonal(H: Float[Array, "n n"], damping: Float[Array, ""]) -> Float[Array, "n"]:
    """`lambda D`, positive also for parameters without effect on the residual."""
    D = jnp.diagonal(H)
    tiny = jnp.finfo(D.dtype).tiny
    return damping * (D + _RELATIVE_FLOOR * jnp.max(D, initial=0.0)) + tiny


def promise(
    g: Float[Array, "n"], step: Float[Array, "n"], diagonal: Float[Array, "n"]
) -> Float[Array, ""]:
    """`-(g dx + 1/2 dx H dx)`, which is `1/2 (dx lambda D dx - g dx)` for the damped step."""
    return 0.5 * (step @ (diagonal * step) - g @ step)
