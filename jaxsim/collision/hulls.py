"""Tables of the convex hulls of a group of geoms."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.shapes import Hull, HullFaces, Shape


class Hulls:
    """Tables of hulls, cut to the largest numbers of corners and faces among some geoms.

    Attributes:
      geom_hull: (ngeom,) row of each geom's hull.
      corner: see `Hull`.
      faces: see `HullFaces`.
    """

    geom_hull: np.ndarray
    corner: Float[Array, "h v 3"]
    faces: HullFaces

    def __init__(self, model: Any, geoms: np.ndarray, dtype):
        self.geom_hull = model.geom_hull
        size = model.hull_size[np.unique(model.geom_hull[geoms])].max(axis=0)
        corners, faces, sides, degree = (int(n) for n in size)
        self.corner = jnp.asarray(model.hull_corner[:, :corners], dtype)
        self.faces = HullFaces(
            normal=jnp.asarray(model.hull_normal[:, :faces], dtype),
            face=jnp.asarray(model.hull_face[:, :faces], jnp.int32),
            ring=jnp.asarray(model.hull_ring, dtype),
            around=jnp.asarray(model.hull_around[:, :corners, :degree], jnp.int32),
            before=jnp.asarray(model.hull_before[:, :corners, :degree], jnp.int32),
            sides=sides,
        )

    def rows(self, geoms: Index) -> Index:
        """The row of each geom's hull."""
        return gather(self.geom_hull, geoms)

    def complete(self, shape: Shape, row: Int[Array, ""]) -> Shape:
        """The shape with the hull in a row."""
        return shape.replace(hull=Hull(self.corner[row], row, self.faces))
