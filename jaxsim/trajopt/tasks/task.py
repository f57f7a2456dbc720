"""`Task`: a problem with a name, a method that solves it, and what counts as solved."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.model import Model, State
from jaxsim.trajopt.plan import Plan
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.solving import Method


@dataclasses.dataclass(frozen=True)
class Task:
    """Something to plan for.

    Attributes:
      about: one sentence.
      make: makes the problem; its dynamics are a model.
      method: solves it from small random controls.
      miss: `(model, last state)` to the distance from the goal (m or rad).
      goal: the distance that counts as solved.
      starts: first guesses that are followed at once; the cheapest plan counts.
      double: whether it needs numbers of double precision.
    """

    about: str
    make: Callable[[], Problem]
    method: Method
    miss: Callable[[Model, State], Float[Array, ""]]
    goal: float
    starts: int = 4
    double: bool = False

    def distance(self, problem: Problem, plan: Plan) -> float:
        """How far from the goal a plan ends."""
        last = jax.tree.map(lambda x: x[-1], plan.states)
        return float(self.miss(model_of(problem), last))


def model_of(problem: Problem) -> Model:
    """The model whose states a problem is about."""
    return problem.space.model  # type: ignore[attr-defined]


def square(x: Float[Array, "n"]) -> Float[Array, ""]:
    """The sum of squares."""
    return jnp.sum(x * x)
