"""What a contact law is: a function from the state of one contact to the cost of its rows."""

from typing import Protocol

from flax import struct
from jaxtyping import Array, Float

from jaxsim.model import Option
from jaxsim.solver import Kind


@struct.dataclass
class ContactState:
    """What a law knows of one contact.

    In the contact frame a relative motion has a normal, two sliding, one spinning and two rolling
    components. The first `condim` of them are rows.

    Attributes:
      dist: signed distance between the surfaces, negative in penetration (m).
      includemargin: the contact is active below this distance (m).
      velocity: `J qvel`, the motion of geom2 relative to geom1; positive normal velocity separates
        (m/s, rad/s).
      inverse_weight: mean inverse inertia of a translation, the sum of both bodies' (1/kg).
      friction: two tangential, one torsional and two rolling coefficients.
      solref: reference of the normal direction.
      solreffriction: reference of the friction directions; zeros mean that `solref` is used.
      solimp: impedance.
    """

    dist: Float[Array, ""]
    includemargin: Float[Array, ""]
    velocity: Float[Array, "condim"]
    inverse_weight: Float[Array, ""]
    friction: Float[Array, "5"]
    solref: Float[Array, "2"]
    solreffriction: Float[Array, "2"]
    solimp: Float[Array, "5"]

    @property
    def condim(self) -> int:
        """Number of rows."""
        return self.velocity.shape[0]


class ContactLaw(Protocol):
    """A law of contact."""

    def __call__(self, opt: Option, contact: ContactState) -> Kind:
        """The cost of the rows of one contact.

        It is mapped over the contacts that share a dimension, so the class of the result may depend
        on `contact.condim` and on static options only. A contact that generates no force has
        `D = 0`.

        Args:
          opt: the model's options, the timestep among them.
          contact: the contact.

        Returns:
          The cost, `aref` and `D` of shape (condim,).
        """
        ...
