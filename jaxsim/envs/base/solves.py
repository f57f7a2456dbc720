"""`Solves`: lost contacts and unconverged solves in a step of a task."""

from flax import struct
from jaxtyping import Array, Bool, Int

from jaxsim.engine.status import Status


@struct.dataclass
class Solves:
    """Status of the solves in all time steps of an action.

    Attributes:
      lost_contacts: largest number of contacts at one time that were lost for lack of slots.
      unconverged: whether a solve ran out of iterations; models may ask for as few as one.
    """

    lost_contacts: Int[Array, ""]
    unconverged: Bool[Array, ""]

    @classmethod
    def of(cls, status: Status) -> "Solves":
        """The numbers from a `Status`."""
        return cls(status.contact_overflow, ~status.converged | ~status.cg_converged)
