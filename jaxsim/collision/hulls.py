"""Tables of the convex hulls of a group of geoms."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision.shapes import Hull, HullCells, HullFaces, Shape
from jaxsim.lanes.switch import tracing_cpu_kernel
from jaxsim.model.facts import fact

# Number of corners from which heights above faces are estimated.
SOME = 48
# Corners are looked up by direction if that leaves less than one in GAIN of them. Programs of XLA
# for CPUs gather one corner in the time in which they compare some in a row.
GAIN, GAIN_OF_XLA = 2, 8


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
        number, index = _tables(model).array, np.dtype(np.int32)
        self.corner = number("corner", dtype, corners)
        self.some = number("some", dtype, corners)
        self.near = None
        if _gain() * near < corners:
            self.near = HullCells(number("cell", index), number("near", index), most=near)
        self.faces = HullFaces(
            normal=number("normal", dtype, faces),
            offset=number("offset", dtype, faces),
            ring=number("ring", dtype),
            face=number("face", index, faces),
            **{name: number(name, index) for name in ("at", "around", "place", "before", "others")},
            sides=sides,
            degree=degree,
        )

    def rows(self, geoms: Index) -> Index:
        """The row of each geom's hull."""
        return gather(self.geom_hull, geoms)

    def complete(self, shape: Shape, row: Int[Array, ""]) -> Shape:
        """The shape with the hull in a row."""
        hull = Hull(self.corner[row], row, self.some[row], self.near, self.faces)
        return shape.replace(hull=hull)


def _gain() -> int:
    on_cpu = jax.default_backend() == "cpu"
    return GAIN_OF_XLA if on_cpu and not tracing_cpu_kernel() else GAIN


class _Tables:
    """Tables of all hulls of a model, as arrays that groups share: each is once in a program."""

    def __init__(self, model: Any):
        first = model.hull_ring[model.hull_face[..., 0]]
        names = "corner normal face ring at around place before others cell near".split()
        self._tables = {name: getattr(model, f"hull_{name}") for name in names}
        self._tables["offset"] = np.sum(model.hull_normal * first, axis=-1)
        self._arrays: dict[Any, Array] = {}

    def array(self, name: str, dtype, columns: int | None = None) -> Array:
        """A table, cut to its first columns; "some" are those of corners, see `Hull`."""
        key = name, np.dtype(dtype), columns
        if key not in self._arrays:
            table = self._tables["corner" if name == "some" else name]
            table = table if columns is None else table[:, :columns]
            with jax.ensure_compile_time_eval():
                table = _spread(table) if name == "some" else table
                self._arrays[key] = jnp.asarray(table, dtype)
        return self._arrays[key]


@fact()
def _tables(model: Any) -> _Tables:
    return _Tables(model)


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
