"""Servos that turn a body to an orientation along the shortest way.

    torque = kp log(q^-1 q*) - kv w,

for an orientation q and an angular velocity w of a ball joint, or of a site relative to another
site. The setpoint q* is a rotation vector or a quaternion. MuJoCo documentation, XML reference,
section "actuator/orientation".
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.forces.controller import Drive, with_gain
from jaxsim.model import Model
from jaxsim.spatial import quat_difference, quat_exp, quat_normalize

SO3 = int(mujoco.mjtGain.mjGAIN_SO3)
_QUAT = int(mujoco.mjtCtrlChart.mjCHART_QUAT)


def integrating(model: Model) -> np.ndarray:
    """Servos whose setpoint is an activation, the integral of the controls; static."""
    ids = with_gain(model, SO3)
    return ids[model.actuator_actnum[ids] > 0]


def setpoint_rows(model: Model) -> np.ndarray:
    """(3 n,) addresses in `act` of the setpoints of all `integrating` servos; static."""
    return _rows(model.actuator_actadr[integrating(model)], 3)


def setpoint_rates(model: Model, drive: Drive) -> Float[Array, "3*n"]:
    """Rates of the setpoints that are activations: the controls."""
    return take(drive.ctrl, _rows(model.actuator_ctrladr[integrating(model)], 3))


def canonical_setpoints(model: Model, act: Float[Array, "na"]) -> Float[Array, "na"]:
    """Activations whose setpoints of more than half a turn are the same rotations within it."""
    rows = setpoint_rows(model)
    if not len(rows):
        return act

    def shortened(turn):
        angle, divisor = norm_and_divisor(turn)
        turns = jnp.round(angle / (2 * jnp.pi))
        return turn * jnp.where(angle > jnp.pi, 1 - 2 * jnp.pi * turns / divisor, 1.0)

    within = jax.vmap(shortened)(take(act, rows).reshape(-1, 3))
    return act.at[rows].set(within.ravel(), unique_indices=True)


def torques(model: Model, drive: Drive, early: Float[Array, "na"]) -> Float[Array, "3*n"]:
    """Torques of all servos in the axes of what they turn.

    Args:
      model: the model.
      drive: controls, activations, lengths and velocities.
      early: activations, after the time step for actuators with `actearly`.
    """
    ids = with_gain(model, SO3)
    rows = force_rows(model)
    length, velocity = (take(x, rows).reshape(-1, 3) for x in (drive.length, drive.velocity))
    error = jax.vmap(lambda turn, target: quat_difference(quat_exp(turn), target))(
        length, _targets(model, ids, drive.ctrl, early)
    )
    kp = take(model.actuator_gainprm[:, 0], ids)[:, None]
    bias = take(model.actuator_biasprm, ids)
    return (kp * error + bias[:, :1] + bias[:, 2:3] * velocity).ravel()


def force_rows(model: Model) -> np.ndarray:
    """(3 n,) addresses of the torques of all servos among the actuators' forces; static."""
    return _rows(model.actuator_outadr[with_gain(model, SO3)], 3)


def limited_torques(model: Model, force: Float[Array, "nout"]) -> Float[Array, "nout"]:
    """Forces in which no torque is larger than the upper bound of its `forcerange`."""
    ids = with_gain(model, SO3)
    ids = ids[np.asarray(model.actuator_forcelimited, bool)[ids]]
    if not len(ids):
        return force
    rows = _rows(model.actuator_outadr[ids], 3)

    def limited(torque, bound):
        size, divisor = norm_and_divisor(torque)
        return torque * jnp.where(size > bound, bound / divisor, 1.0)

    found = jax.vmap(limited)(
        take(force, rows).reshape(-1, 3), take(model.actuator_forcerange[:, 1], ids)
    )
    return force.at[rows].set(found.ravel(), unique_indices=True)


def _targets(model: Model, ids: np.ndarray, ctrl, act) -> Float[Array, "n 4"]:
    """Setpoints as quaternions; a zero quaternion means the identity."""
    found = []
    for i in ids:
        start = model.actuator_ctrladr[i]
        if model.actuator_ctrlspec[i] == _QUAT:
            found.append(quat_normalize(ctrl[start : start + 4]))
        elif model.actuator_actnum[i]:
            start = model.actuator_actadr[i]
            found.append(quat_exp(act[start : start + 3]))
        else:
            found.append(quat_exp(ctrl[start : start + 3]))
    return jnp.stack(found)


def _rows(first: np.ndarray, count: int) -> np.ndarray:
    return (first[:, None] + np.arange(count)).ravel()
