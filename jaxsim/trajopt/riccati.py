"""The backward pass: the best affine policy of a linear-quadratic problem with bounds on controls.

With the value `V(dx) = v' dx + 1/2 dx' P dx` of what follows a step,

    Q_x = g_x + A' (v + P c)     Q_xx = H_xx + A' P A
    Q_u = g_u + B' (v + P c)     Q_ux = H_ux + B' P A     Q_uu = H_uu + B' P B

and the policy is `du = k + K dx`: k minimises `1/2 du' Q_uu du + Q_u' du` within the bounds, and
K is `-Q_uu^-1 Q_ux` for the controls that no bound holds (Tassa et al. 2014).

Differential dynamic programming (Mayne 1966) adds the curvature of the dynamics to all three: the
Hessian of `(v + P c)' f(z)`, with f the next deviation. Then Q_uu may be indefinite, and the policy
is found with the absolute values of its eigenvalues in their place.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.batching import matrices
from jaxsim.trajopt.box_qp import box_qp, restricted_solve
from jaxsim.trajopt.expansion import Expansion


class Policy(NamedTuple):
    """An affine policy `du = k + K dx`, and what it promises.

    Attributes:
      offset: k.
      gains: K.
      slope: v of the value after each step, which is the costate there.
      curvature: P of the value after each step.
      promise: how much the cost falls in the linear-quadratic problem.
    """

    offset: Float[Array, "T nu"]
    gains: Float[Array, "T nu n"]
    slope: Float[Array, "T n"]
    curvature: Float[Array, "T n n"]
    promise: Float[Array, ""]


def backward(
    near: Expansion,
    low: Float[Array, "T nu"],
    high: Float[Array, "T nu"],
    damping: Float[Array, ""],
    bending: Callable[[Float[Array, "n"], Any], Float[Array, "n+nu n+nu"]] | None = None,
    points: Any = None,
) -> Policy:
    """The policy of a linear-quadratic problem, or of one with curved dynamics.

    Args:
      near: the problem.
      low: how far each control may fall.
      high: how far it may rise.
      damping: added to the diagonal of Q_uu while the policy is sought, so that steps are shorter.
      bending: from a costate and a point to the Hessian of their product with the dynamics.
      points: of all steps, (T, ...).
    """
    n = near.defect.shape[1]

    def body(value, now):
        (v, p), (jacobian, defect, gradient, hessian, low, high, point) = value, now
        costate = v + p @ defect
        slope = gradient + jacobian.T @ costate
        curvature = hessian + jacobian.T @ p @ jacobian
        if bending is not None:
            curvature = curvature + bending(costate, point)
        q_u, q_uu, q_ux = slope[n:], curvature[n:, n:], curvature[n:, :n]
        convex = q_uu if bending is None else _absolute(q_uu)
        damped = convex + damping * jnp.eye(len(q_u), dtype=q_u.dtype)
        k, free = box_qp(damped, q_u, low, high)
        gains = -restricted_solve(damped, free, q_ux)
        promise = -(q_u @ k + 0.5 * k @ q_uu @ k)
        before = (
            slope[:n] + gains.T @ (q_uu @ k + q_u) + q_ux.T @ k,
            _symmetric(curvature[:n, :n] + gains.T @ (q_uu @ gains + q_ux) + q_ux.T @ gains),
        )
        return before, Policy(k, gains, v, p, promise)

    end = (near.final_gradient, near.final_hessian)
    inputs = (near.jacobian, near.defect, near.gradient, near.hessian, low, high, points)
    _, policy = lax.scan(body, end, inputs, reverse=True)
    return policy._replace(promise=policy.promise.sum())


def _absolute(matrix: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """The matrix with absolute values of its eigenvalues."""
    values, vectors = matrices.eigh(_symmetric(matrix))
    return (vectors * jnp.abs(values)[None]) @ vectors.T


def _symmetric(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    return (matrix + matrix.T) / 2
