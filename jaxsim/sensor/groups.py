"""Groups of sensors that are read by one function call. Everything here is static."""

import dataclasses

import mujoco
import numpy as np

from jaxsim.model import Model

_JOINT = int(mujoco.mjtObj.mjOBJ_JOINT)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_ACTUATOR = int(mujoco.mjtObj.mjOBJ_ACTUATOR)
_CAMERA = int(mujoco.mjtObj.mjOBJ_CAMERA)


@dataclasses.dataclass(frozen=True)
class SensorGroup:
    """Sensors of one type on objects of one type.

    Attributes:
      kind: name of the sensors' type, `mujoco.mjtSensor` without its prefix.
      objtype: `mujoco.mjtObj` of the objects.
      reftype: `mujoco.mjtObj` of the reference objects; -1 for none.
      variant: type of the joint, shape of the site, camera of an image, first sensor with this grid
        of pixels, number of an actuator's forces or of a callback's readings, if the function
        depends on it; else -1.
      intprm: MuJoCo's integer parameters: which data are read, and how they are reduced.
      sensors: (n,) ids of the sensors.
      obj: (n,) ids of their objects.
      ref: (n,) ids of their reference objects.
    """

    kind: str
    objtype: int
    reftype: int
    variant: int
    intprm: tuple[int, ...]
    sensors: np.ndarray
    obj: np.ndarray
    ref: np.ndarray

    def __len__(self) -> int:
        return len(self.sensors)


def group_sensors(model: Model) -> tuple[SensorGroup, ...]:
    """All sensors of a model, grouped."""
    keys: dict[tuple[str, int, int, int, tuple[int, ...]], list[int]] = {}
    for s in range(model.nsensor):
        keys.setdefault(_key(model, s), []).append(s)
    return tuple(_group(model, *key, ids) for key, ids in sorted(keys.items()))


def _group(model: Model, kind, objtype, reftype, variant, intprm, ids) -> SensorGroup:
    obj, ref = model.sensor_objid[ids], model.sensor_refid[ids]
    return SensorGroup(kind, objtype, reftype, variant, intprm, np.array(ids), obj, ref)


def kinds(model: Model) -> frozenset[str]:
    """Names of the types of a model's sensors, `mujoco.mjtSensor` without its prefix."""
    return frozenset(_kind(model, s) for s in range(model.nsensor))


def _kind(model: Model, s: int) -> str:
    return mujoco.mjtSensor(int(model.sensor_type[s])).name.removeprefix("mjSENS_")


def _key(model: Model, s: int) -> tuple[str, int, int, int, tuple[int, ...]]:
    kind, objtype, obj = _kind(model, s), int(model.sensor_objtype[s]), model.sensor_objid[s]
    ref = model.sensor_refid[s]
    reftype = int(model.sensor_reftype[s]) if ref >= 0 else -1
    variant = -1
    if objtype == _JOINT:
        variant = int(model.jnt_type[obj])
    elif objtype == _ACTUATOR:
        variant = int(model.actuator_outnum[obj])
    elif kind == "USER":
        variant = int(model.sensor_dim[s])
    elif kind == "PLUGIN":
        variant = int(np.argmax((model.sensor_grid == model.sensor_grid[s]).all(axis=1)))
    elif kind == "TOUCH":
        variant = int(model.site_type[obj])
    elif kind == "RANGEFINDER" and objtype == _CAMERA:
        variant = int(obj)
    elif reftype == _SITE and kind == "INSIDESITE":
        variant = int(model.site_type[ref])
    return kind, objtype, reftype, variant, tuple(model.sensor_intprm[s].tolist())
