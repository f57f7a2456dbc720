"""A problem near a trajectory: linear dynamics, quadratic cost, in tangent vectors.

With `z = (dx, du)` the deviation from the trajectory at one step,

- the next deviation is `A dx + B du + c`,
- the cost is `l + g' z + 1/2 z' H z`.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.batching import matrices, vmap
from jaxsim.lanes import as_kernel
from jaxsim.lanes.switch import lanes_enabled
from jaxsim.trajopt.problem import Problem


@struct.dataclass
class Expansion:
    """First and second derivatives along a trajectory; n is the size of the tangent space.

    Attributes:
      jacobian: (A, B), shape (T, n, n + nu).
      defect: c, the gap between where a step leads and the next state.
      gradient: g of the running cost, dx first.
      hessian: H of the running cost, positive semidefinite.
      final_gradient: gradient of the final cost.
      final_hessian: its Hessian, positive semidefinite.
    """

    jacobian: Float[Array, "T n n+nu"]
    defect: Float[Array, "T n"]
    gradient: Float[Array, "T n+nu"]
    hessian: Float[Array, "T n+nu n+nu"]
    final_gradient: Float[Array, "n"]
    final_hessian: Float[Array, "n n"]


def expand(
    problem: Problem, states: Any, ctrls: Float[Array, "T nu"], *, convex: bool = True
) -> Expansion:
    """The problem near states (T+1, ...) and controls; dynamics are taken to first order.

    Args:
      problem: the problem.
      states: along the trajectory.
      ctrls: along the trajectory.
      convex: whether directions in which a cost is concave count as flat, so that each step's
        subproblem is convex.
    """
    space, n = problem.space, problem.space.size
    points = points_of(states, ctrls)
    origin = _origin(problem)

    def running(z, x, u, t):
        return problem.running_cost(space.retract(x, z[:n]), u + z[n:], t)

    def final(dx, x):
        return problem.final_cost(space.retract(x, dx))

    jacobian, defect = vmap(linearised(deviation(problem), origin))(*points)
    steps = jnp.arange(problem.horizon)
    gradient, hessian = jax.vmap(second_order(running, origin, convex))(*points[:2], steps)
    last = jax.tree.map(lambda x: x[-1], states)
    ends = second_order(final, origin[:n], convex)(last)
    return Expansion(jacobian, defect, gradient, hessian, *ends)


def points_of(states: Any, ctrls: Float[Array, "T nu"]) -> tuple[Any, Float[Array, "T nu"], Any]:
    """State, control and next state of every step, (T, ...)."""
    return jax.tree.map(lambda x: x[:-1], states), ctrls, jax.tree.map(lambda x: x[1:], states)


def deviation(problem: Problem) -> Callable[..., Float[Array, "n"]]:
    """Where a step leads beside a point, as a function of z and of this point."""
    space, n = problem.space, problem.space.size
    return lambda z, x, u, y: space.difference(y, problem.step(space.retract(x, z[:n]), u + z[n:]))


def curvature_of_dynamics(problem: Problem) -> Callable[..., Float[Array, "n+nu n+nu"]]:
    """Hessian of `costate' deviation(z)`, as a function of the costate and of a point."""
    f = deviation(problem)
    slope = jax.grad(lambda z, costate, *point: costate @ f(z, *point))
    origin = _origin(problem)
    return lambda costate, point: jax.jacfwd(slope)(origin, costate, *point)


def _origin(problem: Problem) -> Float[np.ndarray, "n+nu"]:
    """Known to kernels, therefore of numpy."""
    return np.zeros(problem.space.size + problem.low.shape[0], problem.low.dtype)


def linearised(f: Callable, origin: Float[np.ndarray, "n"]) -> Callable:
    """Jacobian and value of `f(z, *at)` at an origin, as a function of the rest.

    Where time steps are kernels, each column of the Jacobian is a lane of one.
    """

    def column(direction, *at):
        return jax.jvp(lambda z: f(z, *at), (origin,), (direction,))

    column = as_kernel(column) if lanes_enabled() else column

    def jacobian_and_value(*at):
        directions = jnp.eye(len(origin), dtype=origin.dtype)
        values, columns = jax.vmap(lambda direction: column(direction, *at))(directions)
        return columns.T, values[0]

    return jacobian_and_value


def second_order(cost: Callable, origin: Float[np.ndarray, "n"], convex: bool = True) -> Callable:
    """Gradient of `cost(z, *at)` and its Hessian, or the nearest positive semidefinite matrix."""
    derivatives = linearised(jax.grad(cost), origin)

    def gradient_and_hessian(*at):
        hessian, gradient = derivatives(*at)
        if not convex:
            return gradient, hessian
        values, vectors = matrices.eigh((hessian + hessian.T) / 2)
        return gradient, (vectors * jnp.maximum(values, 0)[None]) @ vectors.T

    return gradient_and_hessian
