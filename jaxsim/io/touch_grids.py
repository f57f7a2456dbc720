"""Touch grids: sensors of MuJoCo's plugin `mujoco.sensor.touch_grid`."""

from collections.abc import Iterator

import mujoco
import numpy as np

from jaxsim.io.plugins import number, numbers, plugins
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

NAME = "mujoco.sensor.touch_grid"
_PLUGIN = int(mujoco.mjtSensor.mjSENS_PLUGIN)


def grid_tables(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields of the model's structure that describe touch grids.

    Args:
      mj: a compiled model.

    Returns:
      `sensor_grid` (nsensor, 6): the numbers of channels, columns and rows; the largest azimuth and
      elevation (rad), and how much smaller pixels in the middle are. Zeros for other sensors.
    """
    table, instances = np.zeros((mj.nsensor, 6)), plugins(mj)
    for s in np.flatnonzero(mj.sensor_type == _PLUGIN):
        given = instances[mj.sensor_plugin[s]].attributes
        channels = max(int(number(given["nchannel"])), 1)
        size, view = numbers(given["size"]), np.radians(numbers(given["fov"]))
        table[s] = channels, *size, *view, number(given["gamma"])
    return {"sensor_grid": table}


def unsupported_grids(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Sensors of other plugins, and grids that MuJoCo leaves zero."""
    instances, seen = plugins(mj), set()
    for s in np.flatnonzero(mj.sensor_type == _PLUGIN):
        who, instance = label("sensor", int(s)), int(mj.sensor_plugin[s])
        if instances[instance].name != NAME:
            yield ModelProblem(who, f"the only plugin of sensors that is supported is {NAME!r}")
        elif instance in seen:
            yield ModelProblem(
                who,
                "MuJoCo computes one touch grid for each plugin instance; give it one of its own",
            )
        seen.add(instance)
