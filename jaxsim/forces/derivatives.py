"""Derivatives of smooth forces with respect to velocity, for the implicit integrators.

As in MuJoCo's `mjd_smooth_vel`, the force of an actuator at its limit is taken as constant, and
limits of joints and tendons on actuator forces are ignored.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import generalized_force, link_bias
from jaxsim.dynamics.tendons.tendon import tendon_jacobian
from jaxsim.dynamics.transmission import scalar_damping, scalar_outputs
from jaxsim.dynamics.velocity import Velocities, velocities
from jaxsim.forces.activation import scalar_actuators
from jaxsim.forces.actuation import Actuation, disabled_actuators, gains
from jaxsim.forces.controller import in_order, with_gain
from jaxsim.forces.damper import dof_damping_slope, has_tendon_damping, tendon_damping_slope
from jaxsim.forces.dc_motor import DCMOTOR
from jaxsim.forces.medium.fluid import has_fluid, link_drag
from jaxsim.forces.orientation import force_rows
from jaxsim.forces.pid import PID
from jaxsim.model import Model

_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION
_AFFINE = (int(mujoco.mjtGain.mjGAIN_AFFINE), int(mujoco.mjtGain.mjGAIN_MUSCLE))
_AFFINE_BIASES = (int(mujoco.mjtBias.mjBIAS_AFFINE), int(mujoco.mjtBias.mjBIAS_SO3))


@struct.dataclass
class Damping:
    """`-d force / d qvel` of passive and actuator forces, `diag(d) + sum_links J^T K J + D`.

    Without lift (of ellipsoids in a medium) it is symmetric.

    Attributes:
      diagonal: d, from joint dampers and actuators of hinges and slides.
      link_matrix: K of each link, from a medium, tree order; None without one.
      dense: D, from other actuators and tendons; None without any.
    """

    diagonal: Float[Array, "nv"]
    link_matrix: Float[Array, "njnt 6 6"] | None
    dense: Float[Array, "nv nv"] | None


def smooth_damping(
    model: Model, kin: Kinematics, vel: Velocities, qvel: Float[Array, "nv"], actuation: Actuation
) -> Damping:
    """Minus the derivative of passive and actuator forces with respect to velocity.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its link velocities.
      qvel: velocities.
      actuation: state of the actuators.
    """
    slope = _actuator_slope(model, actuation)
    diagonal = dof_damping_slope(model, qvel)
    dense = None
    _, others = scalar_outputs(model)
    if slope is not None:
        diagonal = diagonal - scalar_damping(model, actuation.transmission, slope)
        if _depends_on_velocity(model)[others].any():
            rows = actuation.transmission.rows
            dense = -(rows.T * slope[others][None]) @ rows
    if has_tendon_damping(model):
        J = tendon_jacobian(model, kin)
        along = (J.T * tendon_damping_slope(model, kin, qvel)[None]) @ J
        dense = along if dense is None else dense + along
    drag = link_drag(model, kin, vel) if has_fluid(model) else None
    if dense is not None:
        # As in MuJoCo, entries for joints on different branches of the tree are dropped.
        dense = jnp.where(model.structure.related_dofs, dense, 0)
    return Damping(diagonal=diagonal, link_matrix=drag, dense=dense)


def damping_matrix(model: Model, kin: Kinematics, damping: Damping) -> Float[Array, "nv nv"]:
    """The dense matrix of a `Damping`."""
    matrix = jnp.diag(damping.diagonal)
    if damping.dense is not None:
        matrix = matrix + damping.dense
    if damping.link_matrix is None:
        return matrix

    def drag(qvel):
        twist = velocities(model, kin, qvel).cvel
        wrench = jax.vmap(lambda K, v: K @ v)(damping.link_matrix, twist)
        return generalized_force(model, kin, wrench)

    return matrix + jax.vmap(drag, out_axes=1)(jnp.eye(model.nv, dtype=matrix.dtype))


def bias_derivative(
    model: Model, kin: Kinematics, qvel: Float[Array, "nv"]
) -> Float[Array, "nv nv"]:
    """`d qfrc_bias / d qvel`, from Coriolis and centrifugal forces; not symmetric.

    As in MuJoCo, without the bias of tendons' armature.
    """
    return jax.jacfwd(lambda v: link_bias(model, kin, velocities(model, kin, v)))(qvel)


def smooth_velocity_derivative(
    model: Model, kin: Kinematics, qvel: Float[Array, "nv"], actuation: Actuation
) -> Float[Array, "nv nv"]:
    """`d qfrc_smooth / d qvel`: passive and actuator forces minus the bias."""
    vel = velocities(model, kin, qvel)
    damping = smooth_damping(model, kin, vel, qvel, actuation)
    return -damping_matrix(model, kin, damping) - bias_derivative(model, kin, qvel)


def _depends_on_velocity(model: Model) -> np.ndarray:
    """(nout,) whether the type of an actuator allows its force to depend on velocity; static."""
    by_type = np.isin(model.actuator_gaintype, (*_AFFINE, DCMOTOR))
    by_type = by_type | np.isin(model.actuator_biastype, _AFFINE_BIASES)
    return (by_type & ~disabled_actuators(model))[model.structure.out_actuator]


def _actuator_slope(model: Model, actuation: Actuation) -> Float[Array, "nout"] | None:
    """Derivatives of actuator forces with respect to their velocities; None if all are zero."""
    depends = _depends_on_velocity(model)
    if model.opt.disabled(_ACTUATION) or not depends.any():
        return None
    owner, ids = model.structure.out_actuator, scalar_actuators(model)
    affine = np.isin(model.actuator_biastype, _AFFINE_BIASES)
    bias_slope = take(jnp.where(affine, model.actuator_biasprm[:, 2], 0), owner)
    parts = [(model.actuator_outadr[ids], _gain_slopes(model, ids, actuation))]
    if len(motors := with_gain(model, DCMOTOR)):
        parts.append((model.actuator_outadr[motors], actuation.motor_slope))
    others = np.concatenate(
        [model.actuator_outadr[with_gain(model, PID)], force_rows(model), model.pid_actuator]
    )
    parts.append((others, jnp.zeros(len(others), bias_slope.dtype)))
    slope = in_order(parts) + bias_slope
    return jnp.where(depends & ~_saturated(model, actuation.actuator_force), slope, 0)


def _gain_slopes(model: Model, ids: np.ndarray, actuation: Actuation) -> Float[Array, "nscalar"]:
    """Derivatives of `gain * input` of the scalar actuators."""
    rows = model.actuator_outadr[ids]
    length, velocity = (
        take(actuation.actuator_length, rows),
        take(actuation.actuator_velocity, rows),
    )
    _, slope = jax.jvp(lambda v: gains(model, length, v), (velocity,), (jnp.ones_like(velocity),))
    return slope * actuation.actuator_input


def _saturated(model: Model, force: Float[Array, "nout"]) -> Bool[Array, "nout"]:
    """Which forces are at their limits; of a servo of an orientation, the size of its torque is."""
    owner = model.structure.out_actuator
    low, high = take(model.actuator_forcerange, owner).T
    at_limit = (force <= low) | (force >= high)
    if len(rows := force_rows(model)):
        # The size of a limited torque is the limit up to rounding; in MuJoCo, rounding decides.
        sizes = jnp.sqrt(jnp.sum(take(force, rows).reshape(-1, 3) ** 2, axis=1))
        limits = take(high, rows) * (1 - 8 * jnp.finfo(force.dtype).eps)
        at_limit = at_limit.at[rows].set(jnp.repeat(sizes, 3) >= limits)
    return np.asarray(model.actuator_forcelimited, bool)[owner] & at_limit
