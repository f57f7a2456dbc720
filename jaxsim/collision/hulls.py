"""Tables of the convex hulls of a group of geoms."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.shapes import Hull, HullCells, HullFaces, Shape

# Number of corners from which heights above faces are estimated.
SOME = 48
# Corners are looked up by direction if that leaves less than one in GAIN of them.
GAIN = 2


class Hulls:
    """Tables of hulls, cut to the largest numbers of corners and faces among some geoms.

    Attributes:
      geom_hull: (ngeom,) row of each geom's hull.
      corner, some, near: see `Hull`.
      faces: see `HullFaces`.
    """

    geom_hull: np.ndarray
    corner: Float[Array, "h v 3"]
    some: Float[Array, "h k 3"]
    near: HullCells | None
    faces: HullFaces

    def __init__(self, model: Any, geoms: np.ndarray, dtype):
        self.geom_hull = model.geom_hull
        size = model.hull_size[np.unique(model.geom_hull[geoms])].max(axis=0)
        corners, faces, sides, degree, near = (int(n) for n in size)
        self.corner = jnp.asarray(model.hull_corner[:, :corners], dtype)
        self.some = jnp.asarray(_spread(model.hull_corner[:, :corners]), dtype)
        self.near = None
        if GAIN * near < corners:
            tables = (jnp.asarray(x, jnp.int32) for x in (model.hull_cell, model.hull_near))
            self.near = HullCells(*tables, most=near)
        self.faces = HullFaces(
            normal=jnp.asarray(model.hull_normal[:, :faces], dtype),
            offset=jnp.asarray(_offsets(model)[:, :faces], dtype),
            face=jnp.asarray(model.hull_face[:, :faces], jnp.int32),
            ring=jnp.asarray(model.hull_ring, dtype),
            around=jnp.asarray(model.hull_around[:, :corners, :degree], jnp.int32),
            place=jnp.asarray(model.hull_place[:, :corners, :degree], jnp.int32),
            before=jnp.asarray(model.hull_before, jnp.int32),
            others=jnp.asarray(model.hull_others, jnp.int32),
            sides=sides,
        )

    def rows(self, geoms: Index) -> Index:
        """The row of each geom's hull."""
        return gather(self.geom_hull, geoms)

    def complete(self, shape: Shape, row: Int[Array, ""]) -> Shape:
        """The shape with the hull in a row."""
        hull = Hull(self.corner[row], row, self.some[row], self.near, self.faces)
        return shape.replace(hull=hull)


def _offsets(model: Any) -> np.ndarray:
    """See `HullFaces.offset`."""
    first = model.hull_ring[model.hull_face[..., 0]]
    return np.sum(model.hull_normal * first, axis=-1)


def _spread(corner: np.ndarray) -> np.ndarray:
    """(h, k, 3) corners that are the furthest in some of SOME directions, or all if less."""
    if corner.shape[1] <= SOME:
        return corner
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(SOME)
    z = 1 - (2 * np.arange(SOME) + 1) / SOME
    radius = np.sqrt(1 - z**2)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
    furthest = np.argmax(corner @ directions.T, axis=1)
    return np.take_along_axis(corner, furthest[..., None], axis=1)
