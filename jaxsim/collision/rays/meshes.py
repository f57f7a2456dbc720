"""Rays against meshes: the triangles of all of them in one table, so that programs stay small."""

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
    """Where a ray meets the nearest of some meshes, and which one that is.

    The corners are in units of the size, and so is the ray: a linear map does not change where on a
    ray a point is.

    Args:
      source: has the meshes.
      geoms: geoms with meshes, static.
      size: their sizes, the largest coordinates of their corners (m).
      seen: which of them count.
      p: where the ray starts, in the axes of each.
      d: its direction.
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
