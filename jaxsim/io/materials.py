"""Materials of geoms, for the laws of contact that MuJoCo does not have."""

import math
from collections.abc import Mapping

import mujoco
import numpy as np

# Of two geoms in contact, springs and dampers are in series: a geom has twice the stiffness of a
# contact and half its time. Two of these geoms relax within a time step.
STIFFNESS = 2e6
_BOUNDS = {"stiffness": (0.0, math.inf), "relaxation": (0.0, math.inf), "restitution": (0.0, 1.0)}

Materials = Mapping[str, Mapping[str, float]]
"""By name of a geom: `stiffness`, `relaxation` and `restitution`, each optional."""


def material_leaves(
    mj: mujoco.MjModel, materials: Materials | None = None
) -> dict[str, np.ndarray]:
    """The model's leaves `geom_stiffness`, `geom_relaxation` and `geom_restitution`.

    Args:
      mj: the compiled model.
      materials: what differs from the defaults.

    Raises:
      ValueError: there is no such geom, no such parameter, or a number is out of its range.
    """
    defaults = {"stiffness": STIFFNESS, "relaxation": mj.opt.timestep / 2, "restitution": 0.0}
    leaves = {f"geom_{name}": np.full(mj.ngeom, value) for name, value in defaults.items()}
    for geom, values in (materials or {}).items():
        index = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_GEOM, geom)
        if index < 0:
            raise ValueError(f"materials: there is no geom {geom!r}")
        for name, value in values.items():
            leaves[_leaf(geom, name, value)][index] = value
    return leaves


def _leaf(geom: str, name: str, value: float) -> str:
    if name not in _BOUNDS:
        known = ", ".join(_BOUNDS)
        raise ValueError(f"materials: geom {geom!r} has no {name!r}; parameters are {known}")
    low, high = _BOUNDS[name]
    positive = name != "stiffness" or value > 0
    if not (low <= value <= high and positive):
        limits = "positive" if name == "stiffness" else f"between {low:g} and {high:g}"
        raise ValueError(f"materials: {name} of geom {geom!r} must be {limits}, got {value}")
    return f"geom_{name}"
