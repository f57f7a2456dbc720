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


def expand(problem: Problem, states: Any, ctrls: Float[Array, "T nu"]) -> Expansion:
    """The problem near states (T+1, ...) and controls.

    Dynamics are taken to first order (Gauss-Newton). Directions in which a cost is concave count as
    flat, so that each step's subproblem is convex.
    """
    space, n = problem.space, problem.space.size
    before, after = jax.tree.map(lambda x: x[:-1], states), jax.tree.map(lambda x: x[1:], states)
    origin = np.zeros(n + ctrls.shape[1], ctrls.dtype)  # known to kernels

    def stepped(z, x, u, y):
        return space.difference(y, problem.step(space.retract(x, z[:n]), u + z[n:]))

    def running(z, x, u, t):
        return problem.running_cost(space.retract(x, z[:n]), u + z[n:], t)

    def final(dx, x):
        return problem.final_cost(space.retract(x, dx))

    jacobian, defect = vmap(linearised(stepped, origin))(before, ctrls, after)
    steps = jnp.arange(problem.horizon)
    gradient, hessian = jax.vmap(second_order(running, origin))(before, ctrls, steps)
    last = jax.tree.map(lambda x: x[-1], states)
    return Expansion(jacobian, defect, gradient, hessian, *second_order(final, origin[:n])(last))


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


def second_order(cost: Callable, origin: Float[np.ndarray, "n"]) -> Callable:
    """Gradient of `cost(z, *at)`, and the nearest positive semidefinite matrix to its Hessian."""
    derivatives = linearised(jax.grad(cost), origin)

    def gradient_and_hessian(*at):
        hessian, gradient = derivatives(*at)
        values, vectors = matrices.eigh((hessian + hessian.T) / 2)
        return gradient, (vectors * jnp.maximum(values, 0)[None]) @ vectors.T

    return gradient_and_hessian
