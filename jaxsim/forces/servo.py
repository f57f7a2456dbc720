"""Position servos of rotations, whose setpoints are angles modulo whole turns."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.transmission import JOINT, JOINTINPARENT, SITE
from jaxsim.joints import JOINTS
from jaxsim.model import Model

_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_NONE = int(mujoco.mjtDyn.mjDYN_NONE)
_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)


def wrap_setpoint(
    model: Model, setpoint: Float[Array, "nu"], length: Float[Array, "nu"]
) -> Float[Array, "nu"]:
    """Setpoints, those of servos of rotations moved by whole turns to be nearest to the length.

    A servo of a rotation acts on a joint with `Joint.is_angle`, such as a ball joint, or on the
    rotation of a site relative to another site.

    Args:
      model: the model.
      setpoint: input of each actuator.
      length: length of each actuator.
    """
    on_joint, on_site = _rotational(model)
    ids = np.nonzero(on_joint | on_site)[0]
    if not len(ids):
        return setpoint
    gear = take(model.actuator_gear, ids)
    pair = on_site[ids]
    axis = jnp.where(pair[:, None], gear[:, 3:], gear[:, :3])
    square = jnp.sum(axis * axis, axis=1)
    # The numbers decide whether it is a position servo: equal gains and no translation.
    wraps = take(model.actuator_gainprm[:, 0], ids) == -take(model.actuator_biasprm[:, 1], ids)
    wraps = wraps & (square > 0) & (~pair | (gear[:, :3] == 0).all(axis=1))
    period = 2 * jnp.pi * jnp.sqrt(jnp.where(wraps, square, 1.0))
    u = take(setpoint, ids)
    turns = jnp.round((u - take(length, ids)) / period)
    return setpoint.at[ids].add(jnp.where(wraps, -period * turns, 0.0))


def _rotational(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """(nu,) masks of actuators that may be servos of rotations: of joints, and of site pairs."""
    kind, target = model.actuator_trntype, model.actuator_trnid[:, 0]
    servo = (model.actuator_gaintype == _FIXED) & (model.actuator_biastype == _AFFINE)
    servo = servo & np.isin(model.actuator_dyntype, (_NONE, _INTEGRATOR))
    on_joint = np.isin(kind, (JOINT, JOINTINPARENT))
    angle = on_joint.copy()
    angle[on_joint] = [JOINTS[int(t)].is_angle for t in model.jnt_type[target[on_joint]]]
    pair = (kind == SITE) & (model.actuator_trnid[:, 1] >= 0)
    return servo & angle, servo & pair
