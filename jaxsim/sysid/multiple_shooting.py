"""The least squares of identification: parameters, and a first state for every window.

A window's residual depends on the parameters and on its own first state only. With its Jacobians A
and B by these two, a damped Gauss-Newton step is a small system for the parameters,

    (sum A^T A - A^T B (B^T B)^-1 B^T A) dx = -sum A^T (r - B (B^T B)^-1 B^T r),

after which the first states follow window by window.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.batching.matrices import cholesky, cholesky_solve
from jaxsim.solver.levenberg_marquardt import LeastSquares, damped_diagonal, promise
from jaxsim.sysid.prediction import Noise, predict, residual
from jaxsim.sysid.recording import Windows

# Damping of each coordinate, as a part of that of the coordinate which the data know best.
_FLOOR = 1e-3


class Point(NamedTuple):
    """Unknowns.

    Attributes:
      x: coordinates of the parameters.
      starts: for each window what is added to its measured first state.
    """

    x: Float[Array, "p"]
    starts: Float[Array, "W s"]


class Normal(NamedTuple):
    """`J^T J` and `J^T r` by blocks: parameters, parameters by first states, first states."""

    pp: Float[Array, "p p"]
    ps: Float[Array, "W p s"]
    ss: Float[Array, "W s s"]
    gp: Float[Array, "p"]
    gs: Float[Array, "W s"]


class Evaluation(NamedTuple):
    """What is known at a point: normal equations with the prior, and the prediction."""

    normal: Normal
    qpos: Float[Array, "W L nq"]
    qvel: Float[Array, "W L nv"]


class Fitting(NamedTuple):
    """What a fit is about.

    Attributes:
      model: from coordinates of the parameters to the model.
      windows: the data.
      noise: their standard deviations.
      substeps: time steps between samples.
      center: mean of the prior.
      precision: inverse variances of the prior.
      scale: size of each coordinate.
      refine: whether first states are unknown too.
      huber: residual beyond which its cost grows linearly.
    """

    model: Callable
    windows: Windows
    noise: Noise
    substeps: int
    center: Float[Array, "p"]
    precision: Float[Array, "p"]
    scale: Float[Array, "p"]
    refine: bool
    huber: float

    def cost(self, point: Point) -> Float[Array, ""]:
        """The sum of Huber's costs, the prior included."""
        r = jax.vmap(lambda w, s: self._residual(point.x, w, s)[0])(self.windows, point.starts)
        return huber_cost(r, self.huber).sum() + self._prior_cost(point.x)

    def evaluate(self, point: Point) -> tuple[Float[Array, ""], Evaluation]:
        """The cost, and what is known of its neighbourhood."""

        def one(window, start):
            f = lambda x, start: self._residual(x, window, start)  # noqa: E731
            (A, B), (r, *predicted) = jax.jacfwd(f, (0, 1), has_aux=True)(point.x, start)
            B = B if self.refine else jnp.zeros_like(B)
            # Beyond its bend the cost is that of a residual with a smaller weight.
            weight = self.huber / jnp.maximum(jnp.abs(r), self.huber)
            WA, WB = weight[:, None] * A, weight[:, None] * B
            normal = Normal(WA.T @ A, WA.T @ B, WB.T @ B, WA.T @ r, WB.T @ r)
            return huber_cost(r, self.huber).sum(), normal, *predicted

        costs, each, qpos, qvel = jax.vmap(one)(self.windows, point.starts)
        pp = each.pp.sum(0) + jnp.diag(self.precision)
        gp = each.gp.sum(0) + self.precision * (point.x - self.center)
        normal = each._replace(pp=pp, gp=gp)
        return costs.sum() + self._prior_cost(point.x), Evaluation(normal, qpos, qvel)

    def least_squares(self) -> LeastSquares:
        """The problem for `solver.levenberg_marquardt`."""
        return LeastSquares(
            self.evaluate,
            lambda found, damping: damped_step(found.normal, damping, self.scale),
            lambda a, b: jax.tree.map(jnp.add, a, b),
        )

    def _residual(self, x: Float[Array, "p"], window: Windows, start: Float[Array, "s"]):
        """The residual of one window as a vector; it and the prediction."""
        model = self.model(x)
        predicted = predict(model, window, start, self.substeps)
        r = residual(model, window, *predicted, self.noise).ravel()
        return r, (r, *predicted)

    def _prior_cost(self, x):
        return 0.5 * jnp.sum(self.precision * (x - self.center) ** 2)


def huber_cost(r: Float[Array, "*n"], bend: float) -> Float[Array, "*n"]:
    """`r^2 / 2` up to the bend, a straight line beyond it."""
    size = jnp.minimum(jnp.abs(r), bend)
    return size * (jnp.abs(r) - 0.5 * size)


def damped_step(
    normal: Normal, damping: Float[Array, ""], scale: Float[Array, "p"]
) -> tuple[Point, Float[Array, ""]]:
    """The step, and the decrease of the cost that it promises.

    Damping counts coordinates in units of their scales, too: combinations that the data hardly
    determine would take steps so long that the problem is another one there.
    """
    extra = jax.vmap(damped_diagonal, (0, None))(normal.ss, damping)
    known = jnp.diagonal(normal.pp) * scale**2
    diagonal = damped_diagonal(normal.pp, damping) + damping * _FLOOR * known.max() / scale**2
    S, g, Y, y = _eliminated(normal, extra)
    dx = -_solve(S + jnp.diag(diagonal), g[:, None])[:, 0]
    starts = -(y + Y @ dx)
    promised = promise(normal.gp, dx, diagonal)
    return Point(dx, starts), promised + jax.vmap(promise)(normal.gs, starts, extra).sum()


def information(normal: Normal) -> Float[Array, "p p"]:
    """Inverse covariance of the parameters while first states are unknown, prior included."""
    tiny = jax.vmap(damped_diagonal, (0, None))(normal.ss, jnp.asarray(1e-9, normal.ss.dtype))
    return _eliminated(normal, tiny)[0]


def _eliminated(normal: Normal, extra: Float[Array, "W s"]):
    """The system without first states, and these as affine functions of the parameters."""

    def one(ps, ss, gs, extra):
        both = jnp.concatenate([ps.T, gs[:, None]], axis=1)
        return _solve(ss + jnp.diag(extra), both)

    both = jax.vmap(one)(normal.ps, normal.ss, normal.gs, extra)
    Y, y = both[..., :-1], both[..., -1]
    S = normal.pp - jnp.einsum("wps,wsq->pq", normal.ps, Y)
    return S, normal.gp - jnp.einsum("wps,ws->p", normal.ps, y), Y, y


def _solve(H: Float[Array, "n n"], b: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """`H^-1 b` of a positive definite matrix, scaled to a diagonal of ones."""
    scale = jax.lax.rsqrt(jnp.diagonal(H))
    factor = cholesky(H * scale[:, None] * scale[None, :])
    return scale[:, None] * cholesky_solve(factor, scale[:, None] * b)
