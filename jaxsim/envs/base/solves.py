"""`Solves`: what the constraint solver and the contact budget could not do in a step of a task."""

from flax import struct
from jaxtyping import Array, Bool, Int

from jaxsim.engine.status import Status


@struct.dataclass
class Solves:
    """How the solves of all time steps of an action went; numbers that a loop has anyway.

    Attributes:
      lost_contacts: contacts that found no slot, the most at one time.
      unconverged: whether a solve ran out of iterations; a model may ask for as few as one.
    """

    lost_contacts: Int[Array, ""]
    unconverged: Bool[Array, ""]

    @classmethod
    def of(cls, status: Status) -> "Solves":
        """What a status says about them."""
        return cls(status.contact_overflow, ~status.converged | ~status.cg_converged)
