"""`Signals`: the quantities that sensors read."""

from flax import struct
from jaxtyping import Array, Float

from jaxsim.dynamics.motion import Motion
from jaxsim.forces.external import ContactGeometry


@struct.dataclass
class Signals:
    """The quantities that sensors read, in MuJoCo's order and units.

    `motion` is always needed; `needs(model)` names the other fields that a model's sensors read.

    Attributes:
      motion: position and velocity.
      time: seconds.
      energy: potential and kinetic energy (J).
      tendon_length: lengths of the tendons (m).
      tendon_velocity: their rates.
      actuator_length: lengths of the actuators' transmissions.
      actuator_velocity: their rates.
      actuator_force: forces along the actuators.
      qfrc_actuator: generalised forces of all actuators.
      qacc: accelerations, constraints included.
      body_wrench: external (torque, force) on each body about its centre of mass `xipos`, world
        axes, as `forces.external.external_wrench` returns it.
      contact: points, frames and geoms of the contacts.
      contact_force: (force, torque) of each contact on geom2 in the contact's frame, as
        `mj_contactForce` returns it; zero for a contact without force.
      joint_limit_force: force of each joint's limit, not negative; zero if there is no limit or it
        is not active.
      tendon_limit_force: force of each tendon's limit, likewise.
    """

    motion: Motion
    time: Float[Array, ""] | None = None
    energy: Float[Array, "2"] | None = None
    tendon_length: Float[Array, "ntendon"] | None = None
    tendon_velocity: Float[Array, "ntendon"] | None = None
    actuator_length: Float[Array, "nout"] | None = None
    actuator_velocity: Float[Array, "nout"] | None = None
    actuator_force: Float[Array, "nout"] | None = None
    qfrc_actuator: Float[Array, "nv"] | None = None
    qacc: Float[Array, "nv"] | None = None
    body_wrench: Float[Array, "nbody 6"] | None = None
    contact: ContactGeometry | None = None
    contact_force: Float[Array, "nc 6"] | None = None
    joint_limit_force: Float[Array, "njnt"] | None = None
    tendon_limit_force: Float[Array, "ntendon"] | None = None
