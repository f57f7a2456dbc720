"""Rays against meshes: the triangles of all meshes in one table, which keeps programs small."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.indexing import take
from jaxsim.collision.rays.interval import Crossing
from jaxsim.collision.rays.triangles import Triangles, nearest_triangle, triangle_crossing


def mesh_crossing(
    source: mujoco.MjModel,
    geoms: np.ndarray,
    size: Float[Array, "n 3"],
    seen: Bool[Array, "n"],
    p: Float[Array, "n 3"],
    d: Float[Array, "n 3"],
) -> tuple[Crossing, Int[Array, ""]]:
    """The nearest intersection of a ray with some meshes, and the mesh.

    Corners and ray are in units of the size, because a linear map does not change the parameter of
    a point on a ray.

    Args:
      source: the compiled model with the meshes.
      geoms: geoms with meshes, static.
      size: their sizes, the largest coordinates of their corners (m).
      seen: whether the ray can hit each geom.
      p: start of the ray in the axes of each geom.
      d: direction of the ray in the axes of each geom.
    """
    corners = [_corners(source, int(geom)) for geom in geoms]
    table = Triangles.of(np.concatenate(corners), p.dtype)
    owner = np.repeat(np.arange(len(geoms)), [len(c) for c in corners])
    p, d = p / size, d / size
    spread = lambda x: jnp.stack([take(column, owner) for column in x.T])  # noqa: E731
    nearest = nearest_triangle(table, spread(p), spread(d), take(seen, owner))
    which = jnp.asarray(owner)[nearest]
    t, leaving = triangle_crossing(table[nearest], p[which], d[which])
    return (jnp.where(seen[which], t, jnp.inf), leaving), which


def _corners(source: mujoco.MjModel, geom: int) -> np.ndarray:
    """(n, 3, 3) corners of a mesh's triangles, in units of the geom's size."""
    mesh = source.geom_dataid[geom]
    start, first = source.mesh_vertadr[mesh], source.mesh_faceadr[mesh]
    vertices = source.mesh_vert[start : start + source.mesh_vertnum[mesh]].astype(float)
    faces = source.mesh_face[first : first + source.mesh_facenum[mesh]]
    return (vertices / source.geom_size[geom])[faces]
