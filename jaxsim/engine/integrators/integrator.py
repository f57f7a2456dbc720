"""`Integrator`: the interface of integrators, and `Step`, their result."""

from typing import Protocol

from flax import struct
from jaxtyping import Array, Float

from jaxsim.engine.instant import Instant
from jaxsim.engine.status import Status
from jaxsim.model import Model, State


class Evaluate(Protocol):
    """Forces and accelerations of a state, under the controls of the step."""

    def __call__(self, state: State, ahead: Float[Array, ""] | None = None) -> Instant:
        """At a state whose positions may be ahead of its velocities by some time."""
        ...


@struct.dataclass
class Step:
    """The result of a time step.

    `last` is the state whose derived quantities `mj_step` leaves in `mjData`: the state before the
    step, or that of the fourth stage of Runge-Kutta.

    Attributes:
      after: the next state.
      last: the state at which forces were evaluated last.
      qacc: acceleration at `last`.
      status: combined status of the solves of all evaluations.
      readings: of the sensors at the first evaluation; None where they are not remembered, and
        once they are in the history.
    """

    after: State
    last: State
    qacc: Float[Array, "nv"]
    status: Status
    readings: Float[Array, "nsensordata"] | None = None


class Integrator(Protocol):
    """The interface of integrators."""

    def __call__(self, model: Model, state: State, evaluate: Evaluate) -> Step:
        """One time step.

        Args:
          model: the model.
          state: the state.
          evaluate: function from a state to its forces and accelerations.

        Returns:
          The step; the caller sets `qacc_warmstart` of the next state.
        """
        ...
