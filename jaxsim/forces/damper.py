"""Forces of dampers of joints and tendons, and their derivatives with respect to velocity."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.polynomial import damping_force, damping_slope
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_damping, tendon_damping
from jaxsim.dynamics.tendons.tendon import tendon_force_on_joints, tendon_velocity
from jaxsim.dynamics.transmission import TENDON
from jaxsim.model import Model
from jaxsim.model.facts import fact

_DOF_DAMPING = ("dof_damping", "dof_dampingpoly", "actuator_damping", "actuator_dampingpoly")
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def qfrc_damper(model: Model, kin: Kinematics, qvel: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """Generalised forces `-k(|v|) v` of all dampers, with the damping of actuators."""
    if model.opt.disabled(_DAMPER):
        return jnp.zeros_like(qvel)
    force = damping_force(*dof_damping(model), qvel)
    if has_tendon_damping(model):
        along = damping_force(*tendon_damping(model), tendon_velocity(model, kin, qvel))
        force = force + tendon_force_on_joints(model, kin, along)
    return force


def dof_damping_slope(model: Model, qvel: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """Diagonal of `-d force / d qvel` of the joints' dampers; zero if dampers are disabled."""
    if model.opt.disabled(_DAMPER):
        return jnp.zeros_like(qvel)
    return damping_slope(*dof_damping(model), qvel)


@fact(*_DOF_DAMPING)
def damps_dofs(model: Model, *numbers: np.ndarray) -> bool | None:
    """Whether a joint, or an actuator, has damping; None if the numbers are traced."""
    return any(x.any() for x in numbers)


def tendon_damping_slope(
    model: Model, kin: Kinematics, qvel: Float[Array, "nv"]
) -> Float[Array, "ntendon"]:
    """The b in `-d force / d qvel = J^T diag(b) J` for tendon dampers; J is their Jacobian."""
    if model.opt.disabled(_DAMPER):
        return jnp.zeros_like(model.tendon_damping)
    return damping_slope(*tendon_damping(model), tendon_velocity(model, kin, qvel))


def has_tendon_damping(model: Model) -> bool:
    """Whether a tendon, or an actuator of a tendon, may have damping."""
    of_tendons = model.nonzero_rows("tendon_damping") + model.nonzero_rows("tendon_dampingpoly")
    motors = model.nonzero_rows("actuator_damping") + model.nonzero_rows("actuator_dampingpoly")
    return bool(of_tendons) or bool(np.any(model.actuator_trntype[motors,] == TENDON))
