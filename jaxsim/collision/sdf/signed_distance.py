"""Signed distance functions of geoms, and a table of those of a group."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.shapes import Distances, Shape


@struct.dataclass
class SignedDistance:
    """The signed distance function of one geom.

    Attributes:
      parameters: numbers that the function takes as its second argument; None for none.
      function: from a point in the geom's frame (m), and the parameters if there are any, to the
        signed distance (m), negative inside; static.
    """

    parameters: Any
    function: Callable[..., Float[Array, ""]] = struct.field(pytree_node=False)


class SignedDistances:
    """Table of the functions of some geoms."""

    def __init__(self, model: Any, geoms: np.ndarray):
        names = {model.names.id("geom", name): name for name in model.sdf}
        found = [model.sdf[names[geom]] for geom in np.unique(geoms).tolist()]
        self.row = np.zeros(model.ngeom, int)
        self.row[np.unique(geoms)] = np.arange(len(found))
        self.functions = tuple(one.function for one in found)
        self.parameters = tuple(one.parameters for one in found)

    def rows(self, geoms: Index) -> Index:
        """The row of each geom's function."""
        return gather(self.row, geoms)

    def complete(self, shape: Shape, row: Int[Array, ""]) -> Shape:
        """The shape with the function in a row."""
        return shape.replace(sdf=Distances(jnp.asarray(row), self.parameters, self.functions))
