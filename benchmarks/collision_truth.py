"""The largest separation of two convex solids over all directions, by search alone.

Along a unit vector n two solids are `s(n) = n . (c_2 - c_1) - h_1(n) - h_2(-n)` apart, where h are
their support functions. Its maximum is the signed distance: positive for disjoint solids, minus the
depth for overlapping ones. A local maximum is along a normal of a flat face or the cross product of
two edges, on the circle of directions orthogonal to an edge, or where s is smooth. All three are
searched, from many directions. This shares no code with the package.
"""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import lax

# Directions on a circle and on the sphere from which a search starts, and steps of each search.
CIRCLE, SPHERE, CLUSTERS = 48, 384, 16
CIRCLE_STEPS, SPHERE_STEPS = 24, 60


def corners_and_edges(mj: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a mesh's hull in the geom's axes, and unit vectors along its edges."""
    mesh = mj.geom_dataid[geom]
    first, count = mj.mesh_vertadr[mesh], mj.mesh_vertnum[mesh]
    corners = mj.mesh_vert[first : first + count].astype(float)
    found = []
    for face in range(mj.mesh_polynum[mesh]):
        polygon = mj.mesh_polyadr[mesh] + face
        start, sides = mj.mesh_polyvertadr[polygon], mj.mesh_polyvertnum[polygon]
        ring = corners[mj.mesh_polyvert[start : start + sides]]
        found.append(np.roll(ring, -1, axis=0) - ring)
    edges = np.concatenate(found)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    different: list[np.ndarray] = []
    for edge in edges:
        if all(abs(edge @ other) < 1 - 1e-12 for other in different):
            different.append(edge)
    return corners, np.array(different)


class Solid:
    """Support function and edges of a geom, in its axes."""

    def __init__(self, mj: mujoco.MjModel, geom: int):
        self.kind = mujoco.mjtGeom(mj.geom_type[geom]).name[len("mjGEOM_") :].lower()
        self.size = mj.geom_size[geom].copy()
        straight = {"capsule": np.eye(3)[2:], "cylinder": np.eye(3)[2:], "box": np.eye(3)}
        self.edges = straight.get(self.kind, np.zeros((0, 3)))
        self.caps = np.eye(3)[2:] if self.kind == "cylinder" else np.zeros((0, 3))
        if self.kind == "mesh":
            self.corners, self.edges = corners_and_edges(mj, geom)

    def support(self, d):
        """Largest product of unit vectors d (..., 3) with a point of the solid."""
        size = self.size
        if self.kind == "mesh":
            return jnp.max(d @ self.corners.T, axis=-1)
        if self.kind == "box":
            return jnp.abs(d) @ size
        if self.kind == "ellipsoid":
            return jnp.linalg.norm(d * size, axis=-1)
        across = {"sphere": 1.0, "capsule": 1.0}.get(self.kind)
        across = jnp.linalg.norm(d[..., :2], axis=-1) if across is None else across
        return size[0] * across + (0 if self.kind == "sphere" else size[1] * jnp.abs(d[..., 2]))


def signed_distances(mj: mujoco.MjModel, pos: np.ndarray, mat: np.ndarray) -> np.ndarray:
    """(n,) signed distances of a model's two geoms at poses (n, 2, 3) and (n, 2, 3, 3)."""
    first, second = Solid(mj, 0), Solid(mj, 1)
    one = functools.partial(_plane if first.kind == "plane" else _solids, first, second)
    run = jax.jit(lambda p, m: lax.map(lambda x: one(*x), (p, m), batch_size=64))
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        return np.asarray(run(jnp.asarray(pos, float), jnp.asarray(mat, float)))


def _plane(plane: Solid, solid: Solid, pos, mat):
    up = mat[0, :, 2]
    return up @ (pos[1] - pos[0]) - solid.support(-up @ mat[1])


def _solids(first: Solid, second: Solid, pos, mat):
    def separation(n):
        between = n @ (pos[1] - pos[0])
        return between - first.support(n @ mat[0]) - second.support(-n @ mat[1])

    edges = jnp.concatenate([first.edges @ mat[0].T, second.edges @ mat[1].T])
    caps = jnp.concatenate([first.caps @ mat[0].T, second.caps @ mat[1].T])
    rows, columns = np.triu_indices(len(edges), 1)
    crossed = jnp.cross(edges[rows], edges[columns])
    length = jnp.linalg.norm(crossed, axis=1, keepdims=True)
    crossed = jnp.where(length > 1e-12, crossed / jnp.maximum(length, 1e-12), jnp.eye(3)[2])
    normals = jnp.concatenate([crossed, caps])
    found = [_on_sphere(separation)]
    if len(normals):
        found.append(jnp.max(separation(jnp.concatenate([normals, -normals]))))
    if len(edges):
        found.append(jnp.max(jax.vmap(functools.partial(_on_circle, separation))(edges)))
    return jnp.max(jnp.stack(found))


def _on_circle(separation, edge):
    """The largest separation orthogonal to an edge, from the two best local maxima of a grid."""
    u = jnp.cross(edge, jnp.where(jnp.abs(edge) < 0.6, 1.0, 0.0))
    u = u / jnp.linalg.norm(u)
    v = jnp.cross(edge, u)
    at = lambda a: separation(jnp.cos(a)[..., None] * u + jnp.sin(a)[..., None] * v)  # noqa: E731
    grid = np.arange(CIRCLE) * (2 * np.pi / CIRCLE)
    values = at(jnp.asarray(grid))
    peak = (values >= jnp.roll(values, 1)) & (values >= jnp.roll(values, -1))
    best = jnp.asarray(grid)[lax.top_k(jnp.where(peak, values, -jnp.inf), 2)[1]]

    def narrow(k, angle):
        width = 2 * np.pi / CIRCLE * 0.5**k
        tried = angle[:, None] + width * jnp.array([-1.0, -0.5, 0, 0.5, 1])[None]
        return jnp.take_along_axis(tried, jnp.argmax(at(tried), axis=1)[:, None], axis=1)[:, 0]

    return jnp.max(at(lax.fori_loop(0, CIRCLE_STEPS, narrow, best)))


def _on_sphere(separation):
    """The largest separation that a pattern search finds from the best direction of each cluster.

    A step that finds nothing better halves the pattern; each step turns it.
    """
    order = np.arange(SPHERE)
    z = 1 - (2 * order + 1) / SPHERE
    turn, radius = np.pi * (1 + np.sqrt(5)) * order, np.sqrt(1 - z**2)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
    nearest = np.argsort(-(points @ points[:: SPHERE // CLUSTERS].T), axis=0)
    clusters = jnp.asarray(points[nearest[: SPHERE // 8].T])
    best = jnp.argmax(separation(clusters), axis=1)
    start = jnp.take_along_axis(clusters, best[:, None, None], axis=1)[:, 0]

    def step(k, carry):
        n, width = carry
        u = jnp.cross(n, jnp.where(jnp.abs(n) < 0.6, 1.0, 0.0))
        u = u / jnp.linalg.norm(u, axis=1, keepdims=True)
        v = jnp.cross(n, u)
        angle = 2.4 * k + np.arange(6) * (np.pi / 3)
        across = jnp.cos(angle)[:, None] * u[:, None] + jnp.sin(angle)[:, None] * v[:, None]
        tried = n[:, None] + width[:, None, None] * across
        tried = tried / jnp.linalg.norm(tried, axis=2, keepdims=True)
        values = separation(tried)
        better = jnp.max(values, axis=1) > separation(n)
        chosen = jnp.take_along_axis(tried, jnp.argmax(values, axis=1)[:, None, None], axis=1)[:, 0]
        return jnp.where(better[:, None], chosen, n), jnp.where(better, width, width / 2)

    start = start, jnp.full(len(start), 0.2)
    return jnp.max(separation(lax.fori_loop(0, SPHERE_STEPS, step, start)[0]))
