"""What an optimisation leaves: an `Iterate` between its iterations, a `Plan` at the end."""

import enum
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from jaxsim.trajopt.problem import Problem


class PlanStatus(enum.IntEnum):
    """How an optimisation ended."""

    RUNNING = 0
    CONVERGED = 1
    """No step promises to lower the cost by more than the tolerance."""
    STALLED = 2
    """Steps promise to lower the cost, and none does, however short."""
    DIVERGED = 3
    """The first guess has a cost that is not finite."""
    ITERATIONS = 4
    """All iterations are used up."""


@struct.dataclass
class Iterate:
    """Controls, what comes of them, and what a method remembers.

    Attributes:
      ctrls: controls.
      states: states, the first one included.
      cost: their cost.
      status: a `PlanStatus`.
      gains: feedback gains of the tangent space, or None.
      defect: by how much constraints are violated.
      memory: the method's own.
    """

    ctrls: Float[Array, "T nu"]
    states: Any
    cost: Float[Array, ""]
    status: Int[Array, ""]
    gains: Float[Array, "T nu n"] | None
    defect: Float[Array, ""]
    memory: Any


@struct.dataclass
class Plan:
    """Controls that an optimiser found, and how it went.

    Attributes:
      ctrls: controls.
      states: states (T+1, ...), the first one included.
      cost: their cost.
      status: a `PlanStatus`, as a number.
      iterations: how many were made.
      history: cost after each iteration, of which the first only evaluates the guess where a method
        needs that; NaN for those that were not made.
      gains: feedback gains K for `u = ctrls[t] + K (x - states[t])` in the tangent space, or None.
      defect: by how much constraints are violated: forces that are missing, gaps between states,
        limits on states that are exceeded.
    """

    ctrls: Float[Array, "T nu"]
    states: Any
    cost: Float[Array, ""]
    status: Int[Array, ""]
    iterations: Int[Array, ""]
    history: Float[Array, "N"]
    gains: Float[Array, "T nu n"] | None
    defect: Float[Array, ""]

    def ctrl(self, problem: Problem, x: Any, t: Any) -> Float[Array, "nu"]:
        """The control for a state at step t: the planned one, and feedback where there are gains.

        Args:
          problem: what the plan was made for.
          x: the state.
          t: the step, from 0.
        """
        if self.gains is None:
            return self.ctrls[t]
        planned = jax.tree.map(lambda s: s[t], self.states)
        return problem.clip(self.ctrls[t] + self.gains[t] @ problem.space.difference(planned, x))


def shifted(tree: Any) -> Any:
    """What the next step starts from: each array of a trajectory one step later, its end twice."""
    return jax.tree.map(lambda x: jnp.concatenate([x[1:], x[-1:]]), tree)


def first_iterate(problem: Problem, ctrls: Float[Array, "T nu"], memory: Any) -> Iterate:
    """A guess that nobody has evaluated: its states are all the first, and its cost infinite."""
    length = problem.horizon + 1
    return Iterate(
        ctrls=ctrls,
        states=jax.tree.map(lambda x: jnp.broadcast_to(x, (length, *x.shape)), problem.start),
        cost=jnp.asarray(jnp.inf, ctrls.dtype),
        status=jnp.asarray(PlanStatus.RUNNING),
        gains=None,
        defect=jnp.zeros((), ctrls.dtype),
        memory=memory,
    )


def keep_best(now: Iterate, ctrls: Float[Array, "T nu"], states: Any, cost: Array) -> Iterate:
    """The same with other controls, where these cost less."""
    return keep_where(cost < now.cost, now, ctrls, states, cost)


def keep_where(
    better: Bool[Array, ""], now: Iterate, ctrls: Float[Array, "T nu"], states: Any, cost: Array
) -> Iterate:
    """The same with other controls, where these are better."""
    new, old = (ctrls, states, cost), (now.ctrls, now.states, now.cost)
    kept = jax.tree.map(lambda new, old: jnp.where(better, new, old), new, old)
    return now.replace(**dict(zip(("ctrls", "states", "cost"), kept, strict=True)))
