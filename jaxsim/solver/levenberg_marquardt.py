"""Levenberg-Marquardt: a least sum of squares over points of any kind.

The cost is `1/2 |r(x)|^2`. A step dx solves

    (J^T J + lambda D) dx = -J^T r,    D the diagonal of J^T J,

which is Gauss-Newton's step for small damping lambda and a short step downhill for a large one.
Damping follows how much of the promised decrease a step brings (Nielsen 1999, "Damping parameter in
Marquardt's method"). How the system is solved is the problem's business, which may know its
structure. The loop is compiled, has a fixed bound and may be batched.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

_FIRST_DAMPING = 1e-3
_STUCK = 1e8  # damping beyond which no step helps
_RELATIVE_FLOOR = 1e-8  # of D, for parameters that the residual does not depend on

Point = Any
Normal = Any


class LeastSquares(NamedTuple):
    """A problem.

    Attributes:
        evaluate: From a point to its cost and what `solve` needs to know about it.
        solve: From that and a damping to a step, and the decrease of the cost that it promises.
        move: From a point and a step to the next point.
    """

    evaluate: Callable[[Point], tuple[Float[Array, ""], Normal]]
    solve: Callable[[Normal, Float[Array, ""]], tuple[Any, Float[Array, ""]]]
    move: Callable[[Point, Any], Point]


@struct.dataclass
class Iterate:
    """Where a minimisation is.

    Attributes:
        x: The best point so far.
        cost: Its cost.
        normal: What `LeastSquares.evaluate` told about it.
        damping: Lambda of the next step.
        growth: Factor of the damping if the next step fails.
        count: Evaluations.
        converged: Whether no step promises more than the tolerance.
        stuck: Whether no step helps, however short.
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
        """Whether there is nothing left to try."""
        return self.converged | self.stuck


def minimise(problem: LeastSquares, x: Point, *, iterations: int, tolerance: float) -> Iterate:
    """The least cost that is found from a point.

    Args:
        problem: The problem.
        x: Where to begin.
        iterations: Largest number of evaluations.
        tolerance: Relative decrease of the cost below which a step is not worth its while.
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
    """The iterate before the first evaluation at another point; the count goes on."""
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
    """The iterate after one more evaluation, at the next point that a step leads to."""
    fresh = jnp.isinf(now.cost)
    step, promised = problem.solve(now.normal, now.damping)
    promised = jnp.where(fresh, 1.0, promised)
    choose = lambda a, b: jnp.where(fresh, a, b)  # noqa: E731
    trial = jax.tree.map(choose, now.x, problem.move(now.x, step))
    return _judge(now, trial, promised, *problem.evaluate(trial), tolerance)


def _judge(now: Iterate, trial: Point, promised, cost, normal, tolerance: float) -> Iterate:
    """The trial is kept if its cost is lower."""
    better = cost < now.cost  # not if it is NaN
    tiny = jnp.finfo(cost.dtype).tiny
    gain = jnp.clip((now.cost - cost) / jnp.maximum(promised, tiny), 0.0, 2.0)
    shrink = jnp.maximum(1 / 3, 1 - (2 * gain - 1) ** 3)
    damping = now.damping * jnp.where(better, shrink, now.growth)
    # What a step without damping would promise, if D were J^T J.
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
    """The step of a dense problem, and the decrease `-(g dx + 1/2 dx H dx)` that it promises.

    Args:
        H: `J^T J`.
        g: `J^T r`.
        damping: Lambda.
    """
    diagonal = damped_diagonal(H, damping)
    factor = jnp.linalg.cholesky(H + jnp.diag(diagonal))
    half = jax.scipy.linalg.solve_triangular(factor, -g, lower=True)
    step = jax.scipy.linalg.solve_triangular(factor.T, half, lower=False)
    return step, promise(g, step, diagonal)


def damped_diagonal(H: Float[Array, "n n"], damping: Float[Array, ""]) -> Float[Array, "n"]:
    """`lambda D`; a parameter that changes nothing keeps a little of it."""
    D = jnp.diagonal(H)
    tiny = jnp.finfo(D.dtype).tiny
    return damping * (D + _RELATIVE_FLOOR * jnp.max(D, initial=0.0)) + tiny


def promise(
    g: Float[Array, "n"], step: Float[Array, "n"], diagonal: Float[Array, "n"]
) -> Float[Array, ""]:
    """`-(g dx + 1/2 dx H dx)`, which is `1/2 (dx lambda D dx - g dx)` for the damped step."""
    return 0.5 * (step @ (diagonal * step) - g @ step)
