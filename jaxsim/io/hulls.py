"""Convex hulls of the meshes that may collide, as arrays padded to equal size.

MuJoCo's compiler computes the hulls (of at most `maxhullvert` corners) and merges their triangles
into flat faces. Merging may leave out a corner that hardly protrudes; as in MuJoCo, such a corner
belongs to the hull and is on no face.
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
      `hull_normal` (n, f, 3), `hull_face` (n, f, 2), `hull_ring` (r, 3), `hull_at` (n, v, 2),
        `hull_around` (p,), `hull_place` (p,), `hull_before` (p,), `hull_others` (p, 3): see
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
    sides, flat = [h.sides for h in hulls], [h.around for h in hulls]
    faces = _following([f for _, f in sides], [len(corners) for corners, _ in sides])
    cells = _following([c for c, _ in near], [len(numbers) for _, numbers in near])
    at = _following([h.at for h in hulls], [len(h.ring) for h in hulls])
    start = np.cumsum([0, *(len(h.ring) for h in hulls)])
    return {
        "geom_hull": geom_hull,
        "hull_size": size,
        "hull_corner": _table([h.corners for h in hulls], (3,)),
        "hull_normal": _table([h.normals for h in hulls], (3,)),
        "hull_face": _table(faces, (2,)),
        "hull_ring": np.concatenate([np.zeros((0, 3)), *(corners for corners, _ in sides)]),
        "hull_at": _table(at, (2,)),
        "hull_around": _joined([faces for faces, _ in flat]),
        "hull_place": _joined([p + n for (_, p), n in zip(flat, start, strict=False)]),
        "hull_before": _joined([h.before for h in hulls]),
        "hull_others": _others(hulls),
        "hull_cell": _table(cells, (2,)),
        "hull_near": _joined([numbers for _, numbers in near]),
    }


@dataclasses.dataclass(frozen=True)
class _Hull:
    """A hull: its corners (v, 3), and the normals of its faces (f, 3).

    `ring` (p,) has the numbers of the corners around the first face, then the second, and so on,
    counterclockwise seen from outside; `count` (f,) has how many each face has. A place is an index
    into `ring`.
    """

    corners: np.ndarray
    normals: np.ndarray
    ring: np.ndarray
    count: np.ndarray

    @property
    def start(self) -> np.ndarray:
        """(f,) first place of each face."""
        return np.cumsum(self.count) - self.count

    @property
    def size(self) -> tuple[int, int, int, int]:
        """Numbers of corners and faces, largest of a face's corners and of a corner's faces."""
        longest = min(self.count.max(), MAX_SIDES)
        return len(self.corners), len(self.normals), longest, np.bincount(self.ring).max()

    @property
    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of all rings, simplified, and (f, 2) where each ring starts and its length."""
        corners, count = self.corners[self.ring], self.count
        if count.max() > MAX_SIDES:
            rings = [_simplified(ring) for ring in np.split(corners, self.start[1:])]
            corners, count = np.concatenate(rings), np.array([len(r) for r in rings])
        return corners, np.stack([np.cumsum(count) - count, count], axis=1)

    @property
    def before(self) -> np.ndarray:
        """Number of the corner before each place."""
        before = np.roll(self.ring, 1)
        before[self.start] = self.ring[self.start + self.count - 1]
        return before

    @property
    def at(self) -> np.ndarray:
        """(v, 2) where each corner's faces start in `around`, and their number."""
        count = np.bincount(self.ring, minlength=len(self.corners))
        return np.stack([np.cumsum(count) - count, count], axis=1)

    @property
    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """Faces at the first corner, ascending, then at the second, and so on, and its places."""
        places = np.argsort(self.ring, kind="stable")
        return np.repeat(np.arange(len(self.count)), self.count)[places], places


def _others(hulls: list[_Hull]) -> np.ndarray:
    """(p, 3) corners that make a large quadrilateral with each place; -1 if there are none.

    Places are those of all hulls, one hull after the other.
    """
    ring, counts = _joined([h.ring for h in hulls]), _joined([h.count for h in hulls])
    corners = np.concatenate([np.zeros((0, 3)), *(h.corners[h.ring] for h in hulls)])
    start, found = np.cumsum(counts) - counts, np.zeros((len(ring), 3), int)
    for count in np.unique(counts):
        places = start[counts == count, None] + np.arange(count)
        three = widest_with(corners[places])
        rings, of_ring = ring[places], np.arange(len(places))[:, None, None]
        found[places] = np.where(three >= 0, rings[of_ring, three], -1)
    return found


def widest_with(corners: np.ndarray) -> np.ndarray:
    """For each corner of some polygons, three others that make a large quadrilateral with it.

    Three corners that follow it move forward while that makes the area larger, as in MuJoCo. Ratios
    of areas in a plane, and so the result, do not depend on the scale of the axes.

    Args:
      corners: (r, n, 3) corners in order around each polygon.

    Returns:
      (r, n, 3) numbers of corners in this order; -1 in the third column for triangles.
    """
    polygons, count = corners.shape[:2]
    first = np.arange(count)
    at = np.repeat((first + np.arange(1, 4)[:, None])[:, None] % count, polygons, axis=1)
    if count <= 4:
        return np.where(np.arange(1, 4) < count, np.moveaxis(at, 0, 2), -1)
    at, row = at.reshape(3, -1), np.repeat(np.arange(polygons) * count, count)
    point = np.ascontiguousarray(corners.reshape(-1, 3).T)

    def area(places, b, c, d):
        """Twice the areas of the quadrilaterals of some places and three others of each."""
        b, c, d = (row[places] + k for k in (b, c, d))
        (ux, uy, uz), (vx, vy, vz) = point[:, c] - point[:, places], point[:, d] - point[:, b]
        return np.sqrt(
            (uy * vz - uz * vy) ** 2 + (uz * vx - ux * vz) ** 2 + (ux * vy - uy * vx) ** 2
        )

    def advance(which, places):
        """Move one of the three of some places; those where that makes the area larger."""
        moved = at[:, places]
        moved[which] = (moved[which] + 1) % count
        new = area(places, *moved)
        larger = new > largest[places]
        places = places[larger]
        at[which, places], largest[places] = moved[which, larger], new[larger]
        return places

    going = np.arange(polygons * count)
    largest = area(going, *at)
    while len(going := advance(2, going)):
        for which in (1, 0):
            moving = going
            while len(moving := advance(which, moving)):
                pass
    return np.moveaxis(at.reshape(3, polygons, count), 0, 2)


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
    count = mj.mesh_polyvertnum[polygons]
    skipped = mj.mesh_polyvertadr[polygons] - (np.cumsum(count) - count)
    ring = mj.mesh_polyvert[np.repeat(skipped, count) + np.arange(count.sum())]
    # Dividing corners by the size multiplies the normals of planes with it.
    normals = mj.mesh_polynormal[polygons] * size
    on_faces = np.unique(ring)
    kept = np.concatenate([on_faces, np.setdiff1d(_of_graph(mj, mesh), on_faces)])
    number = np.full(len(vertices), -1)
    number[kept] = np.arange(len(kept))
    return _Hull(vertices[kept], normals, number[ring], count)


def _of_graph(mj: mujoco.MjModel, mesh: int) -> np.ndarray:
    """The vertices of a mesh that are corners of its hull before faces are merged."""
    start = mj.mesh_graphadr[mesh]
    count = mj.mesh_graph[start] if start >= 0 else 0
    return mj.mesh_graph[start + 2 + count : start + 2 + 2 * count]


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


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0, int), *parts])


def _following(parts: list[np.ndarray], lengths: list[int]) -> list[np.ndarray]:
    """Rows of where something starts and its number, for lists that are put behind each other."""
    starts = np.cumsum([0, *lengths])
    return [part + np.array([start, 0]) for part, start in zip(parts, starts, strict=False)]
