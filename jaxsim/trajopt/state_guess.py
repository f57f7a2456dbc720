"""Trajectories whose states are a guess: what leads from one to the next has gaps.

    c_t = step(x_t, u_t) - x_{t+1}

A step of length a leaves (1 - a) c_t, so that one of length 1 closes all gaps (Giftthaler et al.
2018, "A family of iterative Gauss-Newton shooting methods for nonlinear optimal control"; Mastalli
et al. 2020, "Crocoddyl"). Trajectories are compared by a merit, as in sequential quadratic
programming:

    merit = cost + (share of the gaps that is open) worth
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.trajopt.expansion import Expansion
from jaxsim.trajopt.problem import Problem, ProblemError
from jaxsim.trajopt.riccati import Policy


def states_from(problem: Problem, guess: Any) -> Any:
    """The guess (T+1, ...) as states of the problem, with its start as the first.

    Raises:
      ProblemError: it is not like the problem's states, or its shape is wrong.
    """
    if jax.tree.structure(guess) != jax.tree.structure(problem.start):
        kinds = type(problem.start).__name__, type(guess).__name__
        raise ProblemError("states must be like the start, a {}, got a {}".format(*kinds))

    def admitted(path, start, given):
        shape = (problem.horizon + 1, *start.shape)
        if jnp.shape(given) != shape:
            name = "states" + jax.tree_util.keystr(path)
            raise ProblemError(f"{name} must have shape {shape}, got {jnp.shape(given)}")
        return jnp.asarray(given, start.dtype).at[0].set(start)

    return jax.tree_util.tree_map_with_path(admitted, problem.start, guess)


def worth_of_gaps(
    near: Expansion, policy: Policy, cost: Float[Array, ""], tolerance: float
) -> Float[Array, ""]:
    """What closing all gaps is worth: twice what it costs at the end of a step of length 1.

    In the linear-quadratic problem the merit then falls all along the step, because the cost is
    convex there. Where closing lowers the cost, it is worth what convergence neglects, which is
    above rounding.
    """

    def body(dx, now):
        jacobian, c, g, h, k, gains = now
        z = jnp.concatenate([dx, k + gains @ dx])
        return jacobian @ z + c, (g + h @ z) @ z

    inputs = (near.jacobian, near.defect, near.gradient, near.hessian, policy.offset, policy.gains)
    dx, slopes = lax.scan(body, jnp.zeros_like(near.final_gradient), inputs)
    slope = slopes.sum() + (near.final_gradient + near.final_hessian @ dx) @ dx
    worth = 2 * jnp.maximum(slope, tolerance * (1 + jnp.abs(cost)))
    return jnp.where(jnp.any(near.defect != 0), worth, 0)
