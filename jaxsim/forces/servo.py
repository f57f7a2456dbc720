"""Servos of rotations, whose setpoints are angles modulo whole turns."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.transmission import JOINT, JOINTINPARENT, SITE
from jaxsim.joints import JOINTS
from jaxsim.model import Model

_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_PID = int(mujoco.mjtGain.mjGAIN_PID)
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_NONE = int(mujoco.mjtDyn.mjDYN_NONE)
_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)


def nearest_setpoint(
    model: Model, ids: np.ndarray, setpoint: Float[Array, "n"], near: Float[Array, "n"]
) -> Float[Array, "n"]:
    """Setpoints, those of servos of rotations moved by whole turns to be nearest to `near`.

    A servo of a rotation acts on a joint with `Joint.is_angle`, such as a ball joint, or on the
    rotation of a site relative to another site.

    Args:
      model: the model.
      ids: actuators, static.
      setpoint: setpoint of each of them.
      near: their lengths, or their previous setpoints.
    """
    on_joint, on_site = _rotational(model)
    turning = np.nonzero((on_joint | on_site)[ids])[0]
    if not len(turning):
        return setpoint
    servos = ids[turning]
    gear = take(model.actuator_gear, model.actuator_outadr[servos])
    pair = on_site[servos]
    axis = jnp.where(pair[:, None], gear[:, 3:], gear[:, :3])
    square = jnp.sum(axis * axis, axis=1)
    # The numbers decide whether it is a position servo: equal gains and no translation.
    equal = take(model.actuator_gainprm[:, 0], servos) == -take(
        model.actuator_biasprm[:, 1], servos
    )
    wraps = equal | (model.actuator_gaintype[servos] == _PID)
    wraps = wraps & (square > 0) & (~pair | (gear[:, :3] == 0).all(axis=1))
    period = 2 * jnp.pi * jnp.sqrt(jnp.where(wraps, square, 1.0))
    turns = jnp.round((take(setpoint, turning) - take(near, turning)) / period)
    return setpoint.at[turning].add(jnp.where(wraps, -period * turns, 0.0))


def integrated_setpoints(model: Model) -> np.ndarray:
    """Servos of rotations whose setpoint is an activation; static."""
    on_joint, on_site = _rotational(model)
    return np.nonzero((on_joint | on_site) & (model.actuator_dyntype == _INTEGRATOR))[0]


def _rotational(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """(nactuator,) masks of possible servos of rotations: of joints, and of site pairs."""
    kind, target = model.actuator_trntype, model.actuator_trnid[:, 0]
    servo = (model.actuator_gaintype == _FIXED) & (model.actuator_biastype == _AFFINE)
    servo = servo & np.isin(model.actuator_dyntype, (_NONE, _INTEGRATOR))
    servo = servo | (model.actuator_gaintype == _PID)
    on_joint = np.isin(kind, (JOINT, JOINTINPARENT))
    angle = on_joint.copy()
    angle[on_joint] = [JOINTS[int(t)].is_angle for t in model.jnt_type[target[on_joint]]]
    pair = (kind == SITE) & (model.actuator_trnid[:, 1] >= 0)
    return servo & angle, servo & pair
