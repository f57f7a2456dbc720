"""What an integrator is: a function from a state, and from forces at any state, to a `Step`."""

from collections.abc import Callable
from typing import Protocol

from flax import struct
from jaxtyping import Array, Float

from jaxsim.engine.instant import Instant
from jaxsim.engine.status import Status
from jaxsim.model import Model, State

Evaluate = Callable[[State], Instant]
"""Forces and accelerations of a state, under the controls of the step."""


@struct.dataclass
class Step:
    """A time step: where it ends, and where forces were evaluated last.

    `mj_step` leaves the derived quantities of its last evaluation in `mjData`: those of the state
    before the step, or of the fourth stage of Runge-Kutta.

    Attributes:
      after: the next state.
      last: the state at which forces were evaluated last.
      qacc: acceleration there.
      status: how the solves of all evaluations went.
    """

    after: State
    last: State
    qacc: Float[Array, "nv"]
    status: Status


class Integrator(Protocol):
    """A method of integration."""

    def __call__(self, model: Model, state: State, evaluate: Evaluate) -> Step:
        """One time step.

        Args:
          model: the model.
          state: the state.
          evaluate: forces and accelerations of a state.

        Returns:
          The step; `qacc_warmstart` of the next state is the caller's business.
        """
        ...
