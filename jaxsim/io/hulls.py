"""Convex hulls of the meshes that may collide, as arrays padded to equal size.

MuJoCo's compiler computes the hulls (of at most `maxhullvert` corners) and merges their triangles
into flat faces. Merging may leave out a corner that hardly protrudes; such a corner is on no face.
Corners are stored in units of the geom's size, the largest absolute coordinate of the mesh along
each axis.
"""

import dataclasses
import warnings
from collections.abc import Iterator

import mujoco
import numpy as np

from jaxsim.collision.cells import furthest_corners
from jaxsim.collision.distance import has_hull, measured_geoms
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

# Faces with more corners are simplified.
MAX_SIDES = 64
# A corner that merging has left out is kept if it protrudes by this fraction of the mesh's size.
PROTRUDES = 1e-7
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
      `hull_size` (n, 5): numbers of corners and faces, largest numbers of corners of a face, of
        faces at a corner and of corners for a cell of directions; the arrays below are padded to
        the largest.
      `hull_corner` (n, v, 3): see `jaxsim.collision.Hull`.
      `hull_normal` (n, f, 3), `hull_face` (n, f, 2), `hull_ring` (r, 3), `hull_around` (n, v, k),
        `hull_place` (n, v, k), `hull_before` (p,), `hull_others` (p, 3): see
        `jaxsim.collision.HullFaces`.
      `hull_cell` (n, cells, 2), `hull_near` (r,): see `jaxsim.collision.Hull`.
    """
    geoms = _geoms(mj)
    meshes, first, row = np.unique(mj.geom_dataid[geoms], return_index=True, return_inverse=True)
    geom_hull = np.full(mj.ngeom, -1)
    geom_hull[geoms] = row
    hulls = [
        _hull(mj, int(mesh), int(geom)) for mesh, geom in zip(meshes, geoms[first], strict=True)
    ]
    near = [furthest_corners(h.corners) for h in hulls]
    size = [(*h.size, cell[:, 1].max()) for h, (cell, _) in zip(hulls, near, strict=True)]
    size = np.array(size, int).reshape(-1, 5)
    _warn_of_many_corners(size, [label("geom", int(geom)) for geom in geoms[first]])
    degree = int(size[:, 3].max(initial=1))
    offset = np.cumsum([0, *(len(np.concatenate(h.rings)) for h in hulls)])
    around = [h.around(degree, start) for h, start in zip(hulls, offset[:-1], strict=True)]
    sides = [h.sides for h in hulls]
    offset = np.cumsum([0, *(len(corners) for corners, _ in sides)])
    faces = [f + np.array([start, 0]) for (_, f), start in zip(sides, offset[:-1], strict=True)]
    offset = np.cumsum([0, *(len(numbers) for _, numbers in near)])
    cells = [c + np.array([start, 0]) for (c, _), start in zip(near, offset[:-1], strict=True)]
    return {
        "geom_hull": geom_hull,
        "hull_size": size,
        "hull_corner": _table([h.corners for h in hulls], (3,)),
        "hull_normal": _table([h.normals for h in hulls], (3,)),
        "hull_face": _table(faces, (2,)),
        "hull_ring": np.concatenate([np.zeros((0, 3)), *(corners for corners, _ in sides)]),
        "hull_around": _table([faces for faces, _ in around], (degree,)),
        "hull_place": _table([place for _, place in around], (degree,)),
        "hull_before": np.concatenate([np.zeros(0, int), *(h.before for h in hulls)]),
        "hull_others": np.concatenate([np.zeros((0, 3), int), *(h.others for h in hulls)]),
        "hull_cell": _table(cells, (2,)),
        "hull_near": np.concatenate([np.zeros(0, int), *(numbers for _, numbers in near)]),
    }


@dataclasses.dataclass(frozen=True)
class _Hull:
    """A hull: corners (v, 3), normals of its faces (f, 3), and the corners around each of them.

    Corners are counterclockwise seen from outside.
    """

    corners: np.ndarray
    normals: np.ndarray
    rings: list[np.ndarray]

    @property
    def size(self) -> tuple[int, int, int, int]:
        """Numbers of corners and faces, largest of a face's corners and of a corner's faces."""
        degree = np.bincount(np.concatenate(self.rings))
        longest = max(map(len, self.rings))
        return len(self.corners), len(self.normals), min(longest, MAX_SIDES), int(degree.max())

    @property
    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of all rings, simplified, and (f, 2) where each ring starts and its length."""
        rings = [_simplified(self.corners[ring]) for ring in self.rings]
        counts = np.array([len(r) for r in rings])
        return np.concatenate(rings), np.stack([np.cumsum(counts) - counts, counts], axis=1)

    @property
    def before(self) -> np.ndarray:
        """Number of the corner before each place of the rings."""
        return np.concatenate([np.roll(ring, 1) for ring in self.rings])

    @property
    def others(self) -> np.ndarray:
        """(p, 3) corners that make a large quadrilateral with each place; -1 if there are none."""
        found = []
        for ring in self.rings:
            three = widest_with(self.corners[ring])
            found.append(np.where(three >= 0, ring[three], -1))
        return np.concatenate(found)

    def around(self, degree: int, start: int) -> tuple[np.ndarray, np.ndarray]:
        """Faces at each corner, and its place in their rings, padded by -1: (v, degree)."""
        faces, places = (np.full((len(self.corners), degree), -1) for _ in range(2))
        filled = np.zeros(len(self.corners), int)
        for face, ring in enumerate(self.rings):
            faces[ring, filled[ring]] = face
            places[ring, filled[ring]] = start + np.arange(len(ring))
            filled[ring] += 1
            start += len(ring)
        return faces, places


def widest_with(corners: np.ndarray) -> np.ndarray:
    """For each corner of a polygon, three others that make a large quadrilateral with it.

    Three corners that follow it move forward while that makes the area larger, as in MuJoCo. Ratios
    of areas in a plane, and so the result, do not depend on the scale of the axes.

    Args:
      corners: (n, 3) corners in order around the polygon.

    Returns:
      (n, 3) numbers of corners in this order; -1 in the third column for a triangle.
    """
    count = len(corners)
    first = np.arange(count)
    at = (first + np.arange(1, 4)[:, None]) % count
    if count <= 4:
        return np.where(np.arange(1, 4) < count, at.T, -1)

    def area(b, c, d):
        across = np.cross(corners[c] - corners[first], corners[d] - corners[b])
        return np.linalg.norm(across, axis=1)

    def advance(which, trying):
        """Move one of the three, where that makes the area larger."""
        moved = at.copy()
        moved[which] = (moved[which] + 1) % count
        new = area(*moved)
        larger = trying & (new > largest)
        at[:, larger], largest[larger] = moved[:, larger], new[larger]
        return larger

    largest = area(*at)
    going = np.ones(count, bool)
    while (going := advance(2, going)).any():
        for which in (1, 0):
            moving = going
            while (moving := advance(which, moving)).any():
                pass
    return at.T


def _geoms(mj: mujoco.MjModel) -> np.ndarray:
    """Mesh geoms that may collide, by masks or a pair, or whose distance a sensor measures."""
    masked = (mj.geom_contype | mj.geom_conaffinity) != 0
    paired = np.isin(np.arange(mj.ngeom), np.concatenate([mj.pair_geom1, mj.pair_geom2]))
    measured = np.isin(np.arange(mj.ngeom), measured_geoms(mj)) & has_hull(mj)
    return np.flatnonzero((mj.geom_type == _MESH) & (masked | paired | measured))


def _hull(mj: mujoco.MjModel, mesh: int, geom: int) -> _Hull:
    start, size = mj.mesh_vertadr[mesh], mj.geom_size[geom]
    vertices = mj.mesh_vert[start : start + mj.mesh_vertnum[mesh]] / size
    polygons = mj.mesh_polyadr[mesh] + np.arange(mj.mesh_polynum[mesh])
    starts = mj.mesh_polyvertadr[polygons]
    rings = [
        mj.mesh_polyvert[start : start + count]
        for start, count in zip(starts, mj.mesh_polyvertnum[polygons], strict=True)
    ]
    # Dividing corners by the size multiplies the normals of planes with it.
    normals = mj.mesh_polynormal[polygons] * size
    on_faces = np.unique(np.concatenate(rings))
    kept = np.concatenate([on_faces, _protruding(mj, mesh, vertices, on_faces, normals)])
    number = np.full(len(vertices), -1)
    number[kept] = np.arange(len(kept))
    return _Hull(vertices[kept], normals, [number[r] for r in rings])


def _protruding(
    mj: mujoco.MjModel,
    mesh: int,
    vertices: np.ndarray,
    on_faces: np.ndarray,
    normals: np.ndarray,
) -> np.ndarray:
    """Vertices of the hull's graph that are on no face and above the plane of one."""
    start = mj.mesh_graphadr[mesh]
    count = mj.mesh_graph[start] if start >= 0 else 0
    graph = mj.mesh_graph[start + 2 + count : start + 2 + 2 * count]
    others = np.setdiff1d(graph, on_faces)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    height = (vertices[others] @ unit.T) - np.max(vertices[on_faces] @ unit.T, axis=0)
    return others[np.any(height > PROTRUDES, axis=1)]


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
