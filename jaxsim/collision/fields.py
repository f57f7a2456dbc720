"""Tables of the height fields of a group of geoms."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.pairs.height_field import window_size
from jaxsim.collision.shapes import HeightField, Shape


class Fields:
    """Tables of height fields, and the number of cells that must be tested."""

    def __init__(self, model: Any, fields: np.ndarray, others: np.ndarray, dtype):
        """Build the tables.

        Args:
          model: the model.
          fields: geoms with height fields.
          others: the geoms that may touch them.
          dtype: type of the numbers.
        """
        self.geom_field = model.geom_field
        count, size = model.field_count[:, ::-1], model.field_size
        step = 2 * size[:, :2] / (count - 1)
        used = np.unique(model.geom_field[fields])
        self.window = window_size(step[used], count[used], model.geom_reach[others].max())
        self.count, self.heights = jnp.asarray(count), jnp.asarray(model.field_height, dtype)
        self.size, self.step = jnp.asarray(size, dtype), jnp.asarray(step, dtype)

    def rows(self, geoms: Index) -> Index:
        """The row of each geom's height field."""
        return gather(self.geom_field, geoms)

    def complete(self, shape: Shape, row: Int[Array, ""]) -> Shape:
        """The shape with the height field in a row."""
        size = self.size[row]
        placed = row, self.count[row], self.step[row], size[:2], size[3]
        return shape.replace(field=HeightField(self.heights, *placed, window=self.window))
