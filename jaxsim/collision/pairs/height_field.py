"""A height field against a convex solid.

Each cell of the grid is split into two triangles, and each triangle with the ground below it is a
prism, as in MuJoCo. A fixed number of prisms, enough for the bounding box of the solid, is tested,
and the deepest contacts are kept. The others are counted as lost.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.collision.convex import Polytope, Solid, convex_pair
from jaxsim.collision.shapes import Contacts, HeightField, Hull, Shape
from jaxsim.collision.spread import one_hot, pick

# Most contacts of one solid with a height field.
MAX_CONTACTS = 8


class Prism(Polytope):
    """A triangular prism, with one contact at most."""

    max_contacts = 1

    def planes(self):
        """See `Solid`."""
        return None


def height_field_pair(
    second: type[Solid],
) -> tuple[Callable[[Shape, Shape], Contacts], int]:
    """The pair function of a height field and a kind of solid, and its number of contact slots."""
    of_prism, _ = convex_pair(Prism, second)

    def pair(field: Shape, solid: Shape) -> Contacts:
        corners, covered = _prisms(field, second, solid)
        found = jax.vmap(lambda c: of_prism(_prism(field, c), solid))(corners)
        single = [x[:, 0] for x in (found.dist, found.pos, found.normal, found.tangent)]
        left, chosen = found.dist[:, 0], []
        for _ in range(MAX_CONTACTS):
            chosen.append(one_hot(-left))
            left = jnp.where(chosen[-1], jnp.inf, left)
        kept = (jnp.stack([pick(m, x) for m in chosen]) for x in single)
        beyond = jnp.where(covered, jnp.inf, -jnp.inf).astype(left.dtype)
        return Contacts(*kept, others=lax.stop_gradient(jnp.append(left, beyond)))

    return pair, MAX_CONTACTS


def _prisms(
    shape: Shape, kind: type[Solid], solid: Shape
) -> tuple[Float[Array, "p 6 3"], Bool[Array, ""]]:
    """Corners of the prisms below a solid, in the field's axes, and whether these are all."""
    field = _field(shape)
    first, covered = _first_cell(field, shape, kind(solid))
    at = [first[k] + jnp.arange(field.window + 1) for k in range(2)]
    height = field.heights[field.row, at[1][:, None], at[0][None]]
    x, y = (at[k] * field.step[k] - field.extent[k] for k in range(2))
    grid = jnp.stack([*jnp.meshgrid(x, y), height], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[:-1, 1:], grid[1:, 1:]
    triangles = jnp.stack([jnp.stack(t, axis=2) for t in ((a, b, d), (a, c, d))])
    top = triangles.reshape(-1, 3, 3)
    bottom = jnp.concatenate([top[..., :2], jnp.full_like(top[..., :1], -field.base)], axis=2)
    return jnp.concatenate([top, bottom], axis=1), covered


def _field(shape: Shape) -> HeightField:
    if shape.field is None:
        raise ValueError("the shape of a height field needs its heights")
    return shape.field


def _first_cell(field: HeightField, shape: Shape, solid: Solid):
    """Column and row of the first tested cell, at the lower corner of the solid's bounding box.

    Also whether the tested cells, whose number was fixed when the model was loaded, cover the box.
    """
    rot = shape.mat.T @ solid.shape.mat
    centre = shape.mat.T @ (solid.shape.pos - shape.pos)
    cells, covered = [], jnp.ones((), bool)
    for k in range(2):
        ends = [
            centre[k] + rot[k] @ solid.support(s * rot[k])[0] + s * solid.radius for s in (-1, 1)
        ]
        low, high = (jnp.floor((x + field.extent[k]) / field.step[k]) for x in ends)
        last = field.count[k] - 1 - field.window
        cells.append(jnp.clip(low.astype(jnp.int32), 0, last))
        covered = covered & (jnp.minimum(high, field.count[k] - 2) < cells[-1] + field.window)
    return cells, covered


def _prism(field: Shape, corners: Float[Array, "6 3"]) -> Shape:
    centre = jnp.mean(corners, axis=0)
    local = corners - centre[None]
    size = jnp.max(jnp.abs(local), axis=0)
    hull = Hull(local / size[None], jnp.zeros((), jnp.int32))
    return Shape(field.pos + field.mat @ centre, field.mat, size, hull)


def window_size(step: np.ndarray, count: np.ndarray, reach: float) -> int:
    """Largest number of cells, along each axis, below a solid.

    Args:
      step: lengths of the cells (m).
      count: numbers of columns and rows of points.
      reach: radius of the solid's bounding sphere (m).
    """
    return int(min(np.ceil(2 * reach / np.min(step)) + 1, np.min(count) - 1))
