"""`sensordata`: the readings of all sensors of a model, in MuJoCo's order."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.model import Model
from jaxsim.sensor import acceleration, position, velocity
from jaxsim.sensor.camera import camprojection
from jaxsim.sensor.contact import contact
from jaxsim.sensor.distance import geomdist, geomfromto, geomnormal
from jaxsim.sensor.groups import SensorGroup, group_sensors, kinds
from jaxsim.sensor.rangefinder import rangefinder
from jaxsim.sensor.readings import Readings
from jaxsim.sensor.signals import Signals
from jaxsim.sensor.touch import touch
from jaxsim.sensor.touch_grid import touch_grid
from jaxsim.sensor.user import user

_SENSOR_OFF = mujoco.mjtDisableBit.mjDSBL_SENSOR
_REAL = int(mujoco.mjtDataType.mjDATATYPE_REAL)
_POSITIVE = int(mujoco.mjtDataType.mjDATATYPE_POSITIVE)
_UNCUT = (int(mujoco.mjtSensor.mjSENS_CONTACT), int(mujoco.mjtSensor.mjSENS_GEOMFROMTO))

_LENGTHS = ("tendon_length", "tendon_velocity")
_FORCES = ("qacc", "body_wrench")
# By type of sensor: the function that reads it, and the optional signals that it reads.
SENSORS = {
    "JOINTPOS": (position.jointpos, ()),
    "TENDONPOS": (position.tendonpos, ("tendon_length",)),
    "ACTUATORPOS": (position.actuatorpos, ("actuator_length",)),
    "BALLQUAT": (position.ballquat, ()),
    "JOINTLIMITPOS": (position.jointlimitpos, ()),
    "TENDONLIMITPOS": (position.tendonlimitpos, _LENGTHS),
    "FRAMEPOS": (position.framepos, ()),
    "FRAMEQUAT": (position.framequat, ()),
    "FRAMEXAXIS": (position.frameaxis, ()),
    "FRAMEYAXIS": (position.frameaxis, ()),
    "FRAMEZAXIS": (position.frameaxis, ()),
    "SUBTREECOM": (position.subtreecom, ()),
    "MAGNETOMETER": (position.magnetometer, ()),
    "INSIDESITE": (position.insidesite, ()),
    "RANGEFINDER": (rangefinder, ()),
    "CAMPROJECTION": (camprojection, ()),
    "GEOMDIST": (geomdist, ()),
    "GEOMNORMAL": (geomnormal, ()),
    "GEOMFROMTO": (geomfromto, ()),
    "E_POTENTIAL": (position.e_potential, ("energy",)),
    "E_KINETIC": (position.e_kinetic, ("energy",)),
    "CLOCK": (position.clock, ("time",)),
    "VELOCIMETER": (velocity.velocimeter, ()),
    "GYRO": (velocity.gyro, ()),
    "JOINTVEL": (velocity.jointvel, ()),
    "TENDONVEL": (velocity.tendonvel, ("tendon_velocity",)),
    "ACTUATORVEL": (velocity.actuatorvel, ("actuator_velocity",)),
    "BALLANGVEL": (velocity.ballangvel, ()),
    "JOINTLIMITVEL": (velocity.jointlimitvel, ()),
    "TENDONLIMITVEL": (velocity.tendonlimitvel, _LENGTHS),
    "FRAMELINVEL": (velocity.framelinvel, ()),
    "FRAMEANGVEL": (velocity.frameangvel, ()),
    "SUBTREELINVEL": (velocity.subtreelinvel, ()),
    "SUBTREEANGMOM": (velocity.subtreeangmom, ()),
    "TOUCH": (touch, ("contact", "contact_force")),
    "CONTACT": (contact, ("contact", "contact_force")),
    "ACCELEROMETER": (acceleration.accelerometer, ("qacc",)),
    "FORCE": (acceleration.force, _FORCES),
    "TORQUE": (acceleration.torque, _FORCES),
    "ACTUATORFRC": (acceleration.actuatorfrc, ("actuator_force",)),
    "JOINTACTFRC": (acceleration.jointactfrc, ("qfrc_actuator",)),
    "TENDONACTFRC": (acceleration.tendonactfrc, ("actuator_force",)),
    "JOINTLIMITFRC": (acceleration.jointlimitfrc, ("joint_limit_force",)),
    "TENDONLIMITFRC": (acceleration.tendonlimitfrc, ("tendon_limit_force",)),
    "FRAMELINACC": (acceleration.framelinacc, ("qacc",)),
    "FRAMEANGACC": (acceleration.frameangacc, ("qacc",)),
    "PLUGIN": (touch_grid, ("contact", "contact_force")),
    "USER": (user, ()),
}


def needs(model: Model) -> frozenset[str]:
    """Which optional fields of `Signals` the model's sensors read; empty if they are disabled."""
    if model.opt.disabled(_SENSOR_OFF):
        return frozenset()
    return frozenset(name for kind in kinds(model) for name in SENSORS[kind][1])


def sensordata(signals: Signals) -> Float[Array, "nsensordata"]:
    """Readings of all sensors, cut off where the model says so.

    Sensors of one type are read together, and only what the model's sensors need is computed.
    Disabled sensors read zero.

    Args:
      signals: what sensors read; of the optional fields, those in `needs(model)`.

    Raises:
      ValueError: an optional signal is missing that a sensor reads.
    """
    model, dtype = signals.motion.model, signals.motion.qpos.dtype
    if not model.nsensor or model.opt.disabled(_SENSOR_OFF):
        return jnp.zeros(model.nsensordata, dtype)
    missing = sorted(name for name in needs(model) if getattr(signals, name) is None)
    if missing:
        raise ValueError(f"the model's sensors need the signals {', '.join(missing)}; got None")
    readings, groups = Readings(signals), group_sensors(model)
    values = [SENSORS[g.kind][0](readings, g).astype(dtype).ravel() for g in groups]
    address = np.concatenate([_addresses(model, g) for g in groups])
    return _cut_off(model, take(jnp.concatenate(values), np.argsort(address)))


def _addresses(model: Model, g: SensorGroup) -> np.ndarray:
    """Where the readings of a group belong in `sensordata`."""
    dim = model.sensor_dim[g.sensors[0]]
    return (model.sensor_adr[g.sensors][:, None] + np.arange(dim)).ravel()


def _cut_off(model: Model, values: Float[Array, "nsensordata"]) -> Float[Array, "nsensordata"]:
    """Clip readings at a positive cutoff: real numbers on both sides, positive ones above.

    Axes, quaternions and the data of contacts are never cut.
    """
    sensor = np.repeat(np.arange(model.nsensor), model.sensor_dim)
    kind = np.where(np.isin(model.sensor_type, _UNCUT), -1, model.sensor_datatype)[sensor]
    if not np.isin(kind, (_REAL, _POSITIVE)).any():
        return values
    cutoff = take(model.sensor_cutoff, sensor)
    bound = jnp.where(cutoff > 0, cutoff, jnp.inf)
    above = jnp.where(jnp.asarray(np.isin(kind, (_REAL, _POSITIVE))), bound, jnp.inf)
    below = jnp.where(jnp.asarray(kind == _REAL), -bound, -jnp.inf)
    return jnp.clip(values, below, above)
