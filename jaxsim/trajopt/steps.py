"""Steps of a problem's dynamics: several of them with one control."""

import dataclasses
from collections.abc import Callable
from typing import Any

from jax import lax
from jaxtyping import Array, Float

import jaxsim.engine as engine
from jaxsim.engine.kernels import reverse_only
from jaxsim.model import Model, State

Step = Callable[[Any, Array], Any]


@dataclasses.dataclass(frozen=True, eq=False)
class ModelSteps:
    """Several steps of a model with one control.

    Attributes:
      model: the model.
      count: how many steps.
    """

    model: Model
    count: int

    def __call__(self, x: State, u: Float[Array, "nu"]) -> State:
        """The state after them."""
        return _repeated(lambda x, u: engine.step(self.model, x, u), self.count)(x, u)

    def reverse_only(self) -> "ModelSteps":
        """The same for a program that takes derivatives in reverse mode only, and once."""
        return dataclasses.replace(self, model=reverse_only(self.model))


def steps_of(dynamics: Model | Step, count: int) -> Step:
    """Several steps of a model or of a function with one control."""
    if isinstance(dynamics, Model):
        return ModelSteps(dynamics, count)
    return _repeated(dynamics, count)


def _repeated(step: Step, count: int) -> Step:
    if count == 1:
        return step
    return lambda x, u: lax.scan(lambda x, _: (step(x, u), None), x, None, length=count)[0]
