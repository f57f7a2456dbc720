"""Marks in a MuJoCo scene: contact points, arrows of forces, centres of mass."""

import mujoco
import numpy as np

_RED, _ORANGE, _GREEN = (0.82, 0.19, 0.19, 1), (0.88, 0.54, 0.0, 1), (0.12, 0.62, 0.33, 1)
_LONGEST = 1.5  # radii of what moves; impacts would fill the picture


def add_contacts(scene: mujoco.MjvScene, rows: np.ndarray, scale: float, extent: float) -> None:
    """A point for each contact, and an arrow for the force on its second geom.

    Args:
      scene: to add to; what it has no room for is left out.
      rows: (n, 6) points and forces, world axes (m, N).
      scale: length of an arrow for each newton (m/N).
      extent: radius of what moves (m), which the marks' sizes go by.
    """
    for row in rows:
        point, arrow = row[:3], row[3:] * scale
        _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, 0.022 * extent, point, _ORANGE)
        length = np.linalg.norm(arrow)
        if length < 0.02 * extent:
            continue
        end = point + arrow * min(1.0, _LONGEST * extent / length)
        geom = _add(scene, mujoco.mjtGeom.mjGEOM_ARROW, 1.0, point, _GREEN)
        if geom is not None:
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, 0.02 * extent, point, end)


def add_center_of_mass(scene: mujoco.MjvScene, point: np.ndarray, extent: float) -> None:
    """A red ball; bodies in front of it hide it unless they are drawn transparent."""
    _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, 0.05 * extent, point, _RED)


def _add(scene: mujoco.MjvScene, kind, size: float, point, rgba) -> mujoco.MjvGeom | None:
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    place, axes = np.asarray(point, float), np.eye(3).ravel()
    mujoco.mjv_initGeom(geom, kind, np.full(3, size), place, axes, np.float32(rgba))
    geom.category, geom.emission = int(mujoco.mjtCatBit.mjCAT_DECOR), 0.3
    scene.ngeom += 1
    return geom
