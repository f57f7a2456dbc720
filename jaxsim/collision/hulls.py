"""Tables of the convex hulls of a group of geoms."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.shapes import Hull, Shape


class Hulls:
    """Tables of hulls, cut to the largest number of corners and faces among some geoms.

    Attributes:
      geom_hull: (ngeom,) row of each geom's hull.
      corner, normal, face: see `Hull`.
    """

    geom_hull: np.ndarray
    corner: Float[Array, "h v 3"]
    normal: Float[Array, "h f 3"]
    face: Float[Array, "h f p 3"]

    def __init__(self, model: Any, geoms: np.ndarray, dtype):
        self.geom_hull = model.geom_hull
        corners, faces = model.hull_size[np.unique(model.geom_hull[geoms])].max(axis=0)
        self.corner = jnp.asarray(model.hull_corner[:, :corners], dtype)
        self.normal = jnp.asarray(model.hull_normal[:, :faces], dtype)
        self.face = jnp.asarray(model.hull_face[:, :faces], dtype)

    def rows(self, geoms: Index) -> Index:
        """The row of each geom's hull."""
        return gather(self.geom_hull, geoms)

    def complete(self, shape: Shape, row: Int[Array, ""]) -> Shape:
        """The shape with the hull in a row."""
        return shape.replace(hull=Hull(self.corner[row], self.normal[row], self.face, row))
