"""`Motion`: kinematics and velocities of a model in one state, before any force is computed."""

from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.velocity import Velocities, velocities
from jaxsim.model import Model, State


@struct.dataclass
class Motion:
    """Kinematics and velocities of a model at one position and velocity.

    Attributes:
      model: the model.
      qpos: coordinates.
      qvel: velocities.
      kin: poses, motion axes and inertias of the links.
      vel: twists of the links, and their accelerations without `qacc`.
      ahead: time by which the position is later than the velocity (s); None for the same time.
      inverse_mass: inverse of the mass matrix, tree order; None where nothing needs it.
    """

    model: Model
    qpos: Float[Array, "nq"]
    qvel: Float[Array, "nv"]
    kin: Kinematics
    vel: Velocities
    ahead: Float[Array, ""] | None = None
    inverse_mass: Float[Array, "nv nv"] | None = None

    def link_origins(self) -> Float[Array, "njnt 3"]:
        """The reference point of each link's tree."""
        return take(self.kin.origin, self.model.tree.root)


def motion_of(model: Model, state: State, ahead: Float[Array, ""] | None = None) -> Motion:
    """The motion of a model in a state, whose position may be ahead of its velocity in time."""
    kin = kinematics(model, state.qpos, state.mocap_pos, state.mocap_quat)
    return Motion(model, state.qpos, state.qvel, kin, velocities(model, kin, state.qvel), ahead)
