"""`Instant`: everything at one instant, accelerations included."""

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
      passive: springs, dampers, gravity compensation, drag.
      actuation: what the actuators do.
      inertial_force: what each link's motion without `qacc` needs, gravity included; tree order.
      qfrc_smooth: all generalised forces but those of constraints, minus the bias.
      constrained: contacts, forces of constraints and the acceleration.
    """

    motion: Motion
    passive: PassiveForces
    actuation: Actuation
    inertial_force: Float[Array, "njnt 6"]
    qfrc_smooth: Float[Array, "nv"]
    constrained: Constrained

    @property
    def qacc(self) -> Float[Array, "nv"]:
        """Acceleration."""
        return self.constrained.qacc

    @property
    def force(self) -> Float[Array, "nv"]:
        """All generalised forces, minus the bias: what `M qacc` is."""
        return self.qfrc_smooth + self.constrained.qfrc_constraint
