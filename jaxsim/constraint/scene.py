"""What the constraint rows are computed from."""

from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.velocity import Velocities
from jaxsim.model import Model
from jaxsim.model.dof_order import to_tree_order


@struct.dataclass
class Scene:
    """A model at one position and velocity."""

    model: Model
    kin: Kinematics
    vel: Velocities
    qpos: Float[Array, "nq"]
    qvel: Float[Array, "nv"]

    def velocity(self, jacobian) -> Array:
        """`J qvel` of a block of rows."""
        return jacobian.apply(to_tree_order(self.model, self.qvel), self.vel.cvel)

    def link_origins(self) -> Float[Array, "njnt 3"]:
        """The reference point of each link's tree."""
        return take(self.kin.origin, self.model.tree.root)
