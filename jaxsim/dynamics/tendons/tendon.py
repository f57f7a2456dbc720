"""Fixed and spatial tendons together: rates of lengths, generalised forces and the Jacobian.

Lengths are in `Kinematics.ten_length`, and the Jacobian of spatial tendons is in
`Kinematics.spatial_J`. For fixed tendons, products with the Jacobian do not build the matrix.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tendons.fixed import fixed_force_on_joints, fixed_jacobian, fixed_velocity
from jaxsim.dynamics.tendons.path import spatial_tendons
from jaxsim.model import Model


def tendon_velocity(
    model: Model, kin: Kinematics, qvel: Float[Array, "nv"]
) -> Float[Array, "ntendon"]:
    """Rates of the lengths, `J qvel`."""
    fixed, spatial = fixed_velocity(model, qvel), spatial_tendons(model)
    if not len(spatial):
        return fixed
    return fixed.at[spatial].set(kin.spatial_J @ qvel, unique_indices=True)


def tendon_force_on_joints(
    model: Model, kin: Kinematics, tension: Float[Array, "ntendon"]
) -> Float[Array, "nv"]:
    """Generalised forces `J^T tension` of forces along the tendons, positive if they lengthen."""
    fixed, spatial = fixed_force_on_joints(model, tension), spatial_tendons(model)
    return fixed + take(tension, spatial) @ kin.spatial_J if len(spatial) else fixed


def tendon_jacobian(model: Model, kin: Kinematics) -> Float[Array, "ntendon nv"]:
    """J, the derivative of the lengths; rows are tendons."""
    spatial = spatial_tendons(model)
    if len(spatial) == model.ntendon:
        return jnp.asarray(kin.spatial_J)
    return fixed_jacobian(model).at[spatial].set(kin.spatial_J, unique_indices=True)
