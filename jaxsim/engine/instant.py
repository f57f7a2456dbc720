"""`Instant`: forces, contacts and accelerations of one state."""

from flax import struct
from jaxtyping import Array, Float

from jaxsim.constraint import Constrained
from jaxsim.dynamics.motion import Motion
from jaxsim.forces.actuation import Actuation
from jaxsim.forces.passive import PassiveForces


@struct.dataclass
class Instant:
    """Forces and accelerations of a state.

    Attributes:
      motion: position and velocity.
      passive: forces of springs, dampers, gravity compensation and drag.
      actuation: state of the actuators.
      qfrc_smooth: all generalised forces except those of constraints, minus the bias.
      constrained: contacts, constraint forces and the acceleration.
      readings: of the sensors, without delays; None where they are not remembered.
    """

    motion: Motion
    passive: PassiveForces
    actuation: Actuation
    qfrc_smooth: Float[Array, "nv"]
    constrained: Constrained
    readings: Float[Array, "nsensordata"] | None = None

    @property
    def qacc(self) -> Float[Array, "nv"]:
        """Acceleration."""
        return self.constrained.qacc

    @property
    def force(self) -> Float[Array, "nv"]:
        """All generalised forces minus the bias, equal to `M qacc`."""
        return self.qfrc_smooth + self.constrained.qfrc_constraint
