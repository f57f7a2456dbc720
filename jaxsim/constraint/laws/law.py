"""`ContactLaw`: a function from the state of one contact to the cost of its rows."""

from typing import Protocol

from flax import struct
from jaxtyping import Array, Float

from jaxsim.constraint.laws.material import Material
from jaxsim.model import Option
from jaxsim.solver import Kind


@struct.dataclass
class ContactState:
    """The state and the parameters of one contact.

    In the contact frame, the relative motion has a normal, two sliding, one spinning and two
    rolling components. The first `condim` of them are rows.

    Attributes:
      dist: signed distance between the surfaces, negative for penetration (m).
      includemargin: distance below which the contact is active (m).
      rounding: bound on the rounding error of `dist` (m).
      velocity: `J qvel`, the motion of geom2 relative to geom1; a positive normal velocity
        separates them (m/s, rad/s).
      inverse_weight: sum of both bodies' mean translational inverse inertia (1/kg).
      friction: two tangential, one torsional and two rolling coefficients.
      solref: `solref` of the normal direction.
      solreffriction: `solref` of the friction directions; zeros mean that `solref` is used.
      solimp: `solimp` of all directions.
      adhesion: force by which the surfaces pull (N); None if the model has no adhesion.
      gap: distance beyond the margin across which they do (m), zero without adhesion; or None.
      material: stiffness, relaxation and restitution; None for the law "mujoco".
    """

    dist: Float[Array, ""]
    includemargin: Float[Array, ""]
    rounding: Float[Array, ""]
    velocity: Float[Array, "condim"]
    inverse_weight: Float[Array, ""]
    friction: Float[Array, "5"]
    solref: Float[Array, "2"]
    solreffriction: Float[Array, "2"]
    solimp: Float[Array, "5"]
    adhesion: Float[Array, ""] | None = None
    gap: Float[Array, ""] | None = None
    material: Material | None = None

    @property
    def condim(self) -> int:
        """Number of rows."""
        return self.velocity.shape[0]


class ContactLaw(Protocol):
    """The interface of contact laws."""

    def __call__(self, opt: Option, contact: ContactState) -> Kind:
        """The cost of the rows of one contact.

        The law is vmapped over contacts of one dimension, so the class of the result may depend
        only on `contact.condim` and on static options. A contact without force has `D = 0`.

        Args:
          opt: the model's options, with the timestep.
          contact: the contact.

        Returns:
          The cost, with `aref` and `D` of shape (condim,).
        """
        ...
