"""What there is to draw of a model: shapes, colours, which bodies move, where to look from."""

import dataclasses
from typing import Any

import mujoco
import numpy as np

_TYPES = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_MESH): "surface",
    int(mujoco.mjtGeom.mjGEOM_HFIELD): "surface",
}
# MuJoCo's viewer shows the geoms of these groups unless told otherwise.
_SHOWN_GROUPS = 3
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)


@dataclasses.dataclass(frozen=True)
class Surface:
    """Triangles: `points` (n, 3), and `faces` (m, 3) of their indices."""

    points: np.ndarray
    faces: np.ndarray


@dataclasses.dataclass(frozen=True)
class Drawing:
    """A model as a drawing program wants it.

    Attributes:
      geoms: for each visible geom its type, size, colour, pose, the slot of the moving body that
        carries it (-1: fixed in the world) and, for meshes and height fields, its surface.
      surfaces: of meshes and height fields.
      moving: ids of the bodies that move.
      extent: radius of what moves, about its middle (m).
      center: middle of what moves at the first state, in the world.
    """

    geoms: list[dict[str, Any]]
    surfaces: list[Surface]
    moving: np.ndarray
    extent: float
    center: np.ndarray


def drawing(model: mujoco.MjModel, data: mujoco.MjData) -> Drawing:
    """The drawing of a model.

    Args:
      model: the model with its looks.
      data: with the poses of the first state.
    """
    moving = moving_bodies(model)
    slot = np.full(model.nbody, -1)
    slot[moving] = np.arange(len(moving))
    shown = [
        g
        for g in range(model.ngeom)
        if model.geom_group[g] < _SHOWN_GROUPS and int(model.geom_type[g]) in _TYPES
    ]
    surfaces, number = [], {}
    geoms = []
    for g in shown:
        body = int(model.geom_bodyid[g])
        fixed = slot[body] < 0
        pos, quat = (
            (data.geom_xpos[g], _quat(data.geom_xmat[g]))
            if fixed
            else (
                model.geom_pos[g],
                model.geom_quat[g],
            )
        )
        entry = {
            "type": _TYPES[int(model.geom_type[g])],
            "size": model.geom_size[g].tolist(),
            "rgba": color(model, g),
            "pos": pos.tolist(),
            "quat": xyzw(quat).tolist(),
            "slot": int(slot[body]),
        }
        if entry["type"] == "surface":
            key = int(model.geom_type[g]), int(model.geom_dataid[g])
            if key not in number:
                number[key] = len(surfaces)
                surfaces.append(_surface(model, *key))
            entry["surface"] = number[key]
        geoms.append(entry)
    return Drawing(geoms, surfaces, moving, *bounds(model, data))


def moving_bodies(model: mujoco.MjModel) -> np.ndarray:
    """Ids of the bodies that joints or mocap poses move."""
    mocap = model.body_mocapid[model.body_rootid] >= 0
    return np.nonzero((model.body_weldid > 0) | mocap)[0]


def color(model: mujoco.MjModel, geom: int) -> list[float]:
    """RGBA of a geom: its own, or its material's where it has none of its own."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.allclose(own, _DEFAULT_RGBA):
        own = model.mat_rgba[material]
    return np.round(own.astype(float), 4).tolist()


def xyzw(quat: np.ndarray) -> np.ndarray:
    """Quaternions with the scalar last, from MuJoCo's with the scalar first."""
    return np.roll(quat, -1, axis=-1)


def _quat(mat: np.ndarray) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.asarray(mat, float).ravel())
    return quat


def bounds(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, np.ndarray]:
    """Radius and middle of the moving geoms; of all geoms but planes where nothing moves."""
    plane = model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)
    chosen = np.isin(model.geom_bodyid, moving_bodies(model)) & ~plane
    chosen = chosen if chosen.any() else ~plane
    if not chosen.any():
        return 1.0, np.zeros(3)
    pos, radius = data.geom_xpos[chosen], model.geom_rbound[chosen][:, None]
    low, high = (pos - radius).min(0), (pos + radius).max(0)
    center = (low + high) / 2
    return float(max((np.linalg.norm(pos - center, axis=1) + radius[:, 0]).max(), 1e-3)), center


def _surface(model: mujoco.MjModel, kind: int, number: int) -> Surface:
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        start, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
        face, faces = model.mesh_faceadr[number], model.mesh_facenum[number]
        return Surface(model.mesh_vert[start : start + count], model.mesh_face[face : face + faces])
    return _height_field(model, number)


def _height_field(model: mujoco.MjModel, number: int) -> Surface:
    """The top of a height field: two triangles for each cell of the grid."""
    rows, columns = int(model.hfield_nrow[number]), int(model.hfield_ncol[number])
    start = model.hfield_adr[number]
    height = model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    x, y, top, _ = model.hfield_size[number]
    grid = np.meshgrid(np.linspace(-x, x, columns), np.linspace(-y, y, rows))
    points = np.stack([*grid, top * height], axis=-1).reshape(-1, 3)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
    faces = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    return Surface(points, faces)
