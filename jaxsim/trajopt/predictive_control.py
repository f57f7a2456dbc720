"""Model-predictive control: plan, apply the first control, plan again from there."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.trajopt.plan import Iterate
from jaxsim.trajopt.problem import Problem, ProblemError
from jaxsim.trajopt.solving import Method, check_method, guess
from jaxsim.trajopt.space import stack


class Track(NamedTuple):
    """What a controller did.

    Attributes:
      states: states (N+1, ...), the first one included.
      ctrls: controls applied.
      costs: what each plan expected to pay from its first state on.
      status: a `PlanStatus` of each plan.
    """

    states: Any
    ctrls: Float[Array, "N nu"]
    costs: Float[Array, "N"]
    status: Int[Array, "N"]


def replan(
    problem: Problem, method: Method, now: Iterate, state: Any, iterations: Any = 1
) -> Iterate:
    """A plan that begins at a state, from the one made a step before.

    The old plan, one step later and with the state's deviation from it fed back where there are
    gains, is the first guess. Its first control, `ctrls[0]`, is the one to apply.

    Args:
      problem: the problem; its start is replaced.
      method: an optimiser.
      now: the last plan, `method.start(...)` or of the call before; `method.shift` brings it to
        the present.
      state: the present state.
      iterations: of the optimiser.
    """
    problem = problem.replace(start=state)
    return lax.fori_loop(0, iterations, lambda _, now: method.improve(problem, now), now)


def mpc(
    problem: Problem,
    method: Method,
    steps: int,
    ctrls: Float[Array, "T nu"] | None = None,
    *,
    key: jax.Array | None = None,
    iterations: int = 1,
    first_iterations: int | None = None,
    plant: Callable[[Any, Array], Any] | None = None,
) -> Track:
    """Control a system for a while by planning anew at each step; a pure function, to be jitted.

    Args:
      problem: what to plan for, from its start; costs see the time from the present step.
      method: an optimiser; its `iterations` are not used.
      steps: how many controls are applied.
      ctrls: first guess; small random controls by default.
      key: as in `solve`.
      iterations: of the optimiser for each control.
      first_iterations: of the optimiser before the first control.
      plant: `(x, u)` to the next state, where that is not the problem's own model; u are the
        problem's controls, contact forces included where they are unknowns.

    Raises:
      ProblemError: the guess has the wrong shape, there are no steps or iterations, or the method
        does not know what the problem has.
    """
    check_method(problem, method)
    if steps < 1 or iterations < 1:
        raise ProblemError(f"steps and iterations must be at least 1, got {steps} and {iterations}")
    plant = problem.step if plant is None else plant
    ctrls, key = guess(problem, ctrls, key)
    first = iterations if first_iterations is None else first_iterations
    counts = jnp.full(steps, iterations).at[0].set(first)

    def body(carry, count):
        state, now = carry
        now = replan(problem, method, now, state, count)
        state = plant(state, now.ctrls[0])
        return (state, method.shift(now)), Track(state, now.ctrls[0], now.cost, now.status)

    carry = (problem.start, method.start(problem, ctrls, key))
    _, track = lax.scan(body, carry, counts)
    return track._replace(states=stack(problem.start, track.states))
