"""Convex hulls of the meshes that may collide, as arrays padded to equal size.

MuJoCo's compiler computes the hulls (of at most `maxhullvert` corners) and merges their triangles
into flat faces. Corners are stored in units of the geom's size, the largest absolute coordinate of
the mesh along each axis.
"""

import warnings
from collections.abc import Iterator

import mujoco
import numpy as np

from jaxsim.collision.distance import has_hull, measured_geoms
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

# Faces with more corners are simplified: 16 are enough for face contacts, as for cylinders.
MAX_SIDES = 16
# Hulls with more corners give a warning, because their collisions are slow.
MANY_CORNERS = 128

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


def flat_meshes(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Problems of geoms that may collide and whose convex hull has no volume."""
    for geom in _geoms(mj):
        mesh, size = mj.geom_dataid[geom], mj.geom_size[geom]
        if not mj.mesh_polynum[mesh] or size.min() < 1e-6 * size.max():
            yield ModelProblem(
                label("geom", int(geom)), "may collide, but the hull of its mesh is flat"
            )


def hull_tables(mj: mujoco.MjModel, label: Label) -> dict[str, np.ndarray]:
    """Fields of the model's structure that describe the hulls of its meshes.

    Args:
      mj: a compiled model.
      label: from (kind, id) to the name of an element in messages.

    Returns:
      `geom_hull` (ngeom,): hull of each geom, -1 for other shapes and geoms that cannot collide.
      `hull_size` (n, 2): numbers of corners and faces; the arrays below are padded to the largest.
      `hull_corner` (n, v, 3), `hull_normal` (n, f, 3), `hull_face` (n, f, p, 3): see
      `jaxsim.collision.Hull`.
    """
    geoms = _geoms(mj)
    meshes, first, row = np.unique(mj.geom_dataid[geoms], return_index=True, return_inverse=True)
    geom_hull = np.full(mj.ngeom, -1)
    geom_hull[geoms] = row
    hulls = [
        _hull(mj, int(mesh), int(geom)) for mesh, geom in zip(meshes, geoms[first], strict=True)
    ]
    corners, normals, faces = [h[0] for h in hulls], [h[1] for h in hulls], [h[2] for h in hulls]
    size = np.array([[len(c), len(n)] for c, n in zip(corners, normals, strict=True)], int)
    size = size.reshape(-1, 2)
    _warn_of_many_corners(size, [label("geom", int(geom)) for geom in geoms[first]])
    sides = max((len(ring) for face in faces for ring in face), default=1)
    stacked = [np.stack([_padded(ring, sides, ring[-1:]) for ring in face]) for face in faces]
    return {
        "geom_hull": geom_hull,
        "hull_size": size,
        "hull_corner": _table(corners, (3,)),
        "hull_normal": _table(normals, (3,)),
        "hull_face": _table(stacked, (sides, 3)),
    }


def _geoms(mj: mujoco.MjModel) -> np.ndarray:
    """Mesh geoms that may collide, by masks or a pair, or whose distance a sensor measures."""
    masked = (mj.geom_contype | mj.geom_conaffinity) != 0
    paired = np.isin(np.arange(mj.ngeom), np.concatenate([mj.pair_geom1, mj.pair_geom2]))
    measured = np.isin(np.arange(mj.ngeom), measured_geoms(mj)) & has_hull(mj)
    return np.flatnonzero((mj.geom_type == _MESH) & (masked | paired | measured))


def _hull(
    mj: mujoco.MjModel, mesh: int, geom: int
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Corners (v, 3), normals (f, 3), and for each face its corners (p, 3)."""
    start, size = mj.mesh_vertadr[mesh], mj.geom_size[geom]
    vertices = mj.mesh_vert[start : start + mj.mesh_vertnum[mesh]] / size
    polygons = mj.mesh_polyadr[mesh] + np.arange(mj.mesh_polynum[mesh])
    starts = mj.mesh_polyvertadr[polygons]
    rings = [
        mj.mesh_polyvert[start : start + count]
        for start, count in zip(starts, mj.mesh_polyvertnum[polygons], strict=True)
    ]
    corners = vertices[np.unique(np.concatenate(rings))]
    # Dividing corners by the size multiplies the normals of planes with it.
    normals = mj.mesh_polynormal[polygons] * size
    return corners, normals, [_simplified(vertices[ring]) for ring in rings]


def _warn_of_many_corners(size: np.ndarray, labels: list[str]) -> None:
    large = [f"{who} ({n})" for who, n in zip(labels, size[:, 0], strict=True) if n > MANY_CORNERS]
    if large:
        warnings.warn(
            f"convex hulls of more than {MANY_CORNERS} corners collide slowly: {', '.join(large)}; "
            f'set maxhullvert="{MANY_CORNERS // 2}" on their meshes',
            stacklevel=2,
        )


def _simplified(ring: np.ndarray) -> np.ndarray:
    """The polygon reduced to MAX_SIDES corners, leaving out those that change its area least."""
    while len(ring) > MAX_SIDES:
        before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
        area = np.linalg.norm(np.cross(ring - before, after - before), axis=1)
        ring = np.delete(ring, np.argmin(area), axis=0)
    return ring


def _padded(rows: np.ndarray, count: int, filler: np.ndarray) -> np.ndarray:
    return np.concatenate([rows, np.repeat(filler, count - len(rows), axis=0)])


def _table(parts: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    count = max((len(p) for p in parts), default=0)
    rows = [_padded(p, count, p[:1]) for p in parts]
    return np.array(rows).reshape(len(parts), count, *shape)
