"""A height field against a convex solid.

Each cell of the grid is split into two triangles, and each triangle with the ground below it is a
prism, as in MuJoCo. A fixed number of prisms, enough for the bounding box of the solid, is tested,
and the deepest contacts are kept. The others are counted as lost. Spheres have a closed form.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.collision.convex import Point, Polytope, Solid, convex_pair
from jaxsim.collision.convex.solid import Planes
from jaxsim.collision.frames import tangent_of
from jaxsim.collision.pairs.prism import point_prisms
from jaxsim.collision.shapes import INACTIVE, Contacts, HeightField, Hull, Shape
from jaxsim.collision.spread import one_hot, pick

# Most contacts of one solid with a height field.
MAX_CONTACTS = 8


class Prism(Polytope):
    """A triangular prism, with one contact at most."""

    max_contacts = 1

    def axes(self):
        """See `Solid`."""
        edge = jnp.roll(self.corner[:3], -1, axis=0) - self.corner[:3]
        edge = edge / jnp.sqrt(jnp.sum(edge**2, axis=1))[:, None]
        return jnp.concatenate([super().axes(), edge])

    def planes(self):
        """See `Solid`; of the top and the sides."""
        top, up = self.corner[:3], jnp.eye(3, dtype=self.size.dtype)[2]
        edge = jnp.roll(top, -1, axis=0) - top
        sides = jnp.cross(edge, up[None])
        normal = jnp.concatenate([jnp.cross(edge[0], edge[1])[None], sides])
        normal = normal / jnp.sqrt(jnp.sum(normal**2, axis=1))[:, None]
        offset = normal @ top[0], jnp.sum(normal[1:] * top, axis=1)
        offset = jnp.concatenate([offset[0][:1], offset[1]])
        outward = jnp.where(offset < 0, -1, 1).astype(normal.dtype)
        return Planes(outward[:, None] * normal, outward * offset)


def height_field_pair(
    second: type[Solid],
) -> tuple[Callable[[Shape, Shape], Contacts], int]:
    """The pair function of a height field and a kind of solid, and its number of contact slots."""
    of_prism, _ = convex_pair(Prism, second)

    def pair(field: Shape, solid: Shape) -> Contacts:
        window = _window(field, second(solid))
        found = jax.vmap(lambda c: of_prism(_prism(field, c), solid))(_prisms(window))
        return _in_slots(jax.tree.map(lambda x: x[:, 0], found), window.covered)

    return pair, MAX_CONTACTS


def height_field_sphere(field: Shape, sphere: Shape) -> Contacts:
    """A height field and a sphere, in closed form."""
    window, radius = _window(field, Point(sphere)), sphere.size[0]
    x, y, z = field.mat.T @ (sphere.pos - field.pos)
    dist, normal = point_prisms(
        (x - window.x, y - window.y), window.height, z, window.field.step, window.field.base
    )
    normal = normal @ field.mat.T
    pos = sphere.pos[None] - normal * ((dist + radius) / 2)[:, None]
    found = Contacts(dist - radius, pos, normal, jax.vmap(tangent_of)(normal))
    return _in_slots(found, window.covered)


def _in_slots(found: Contacts, covered: Bool[Array, ""]) -> Contacts:
    """The deepest contacts; if there are not more than slots, in the order of their prisms."""
    number, slot = len(found.dist), np.arange(MAX_CONTACTS)
    if number <= MAX_CONTACTS:
        kept = jax.tree.map(lambda x: x[np.minimum(slot, number - 1)], found)
        kept = kept.replace(dist=jnp.where(slot < number, kept.dist, INACTIVE))
        left = jnp.zeros(0, found.dist.dtype)
    else:
        left, chosen = found.dist, []
        for _ in range(MAX_CONTACTS):
            chosen.append(one_hot(-left))
            left = jnp.where(chosen[-1], jnp.inf, left)
        kept = jax.tree.map(lambda x: jnp.stack([pick(m, x) for m in chosen]), found)
    beyond = jnp.where(covered, jnp.inf, -jnp.inf).astype(left.dtype)
    return kept.replace(others=lax.stop_gradient(jnp.append(left, beyond)))


@struct.dataclass
class _Window:
    """The tested cells.

    Attributes:
      field: the height field.
      x: coordinates of the columns of points, in the field's axes.
      y: coordinates of the rows of points.
      height: heights of the points.
      covered: whether these cells are all below the bounding box of the solid.
    """

    field: HeightField
    x: Float[Array, "c"]
    y: Float[Array, "r"]
    height: Float[Array, "r c"]
    covered: Bool[Array, ""]


def _window(shape: Shape, solid: Solid) -> _Window:
    field = _field(shape)
    first, covered = _first_cell(field, shape, solid)
    column, row = (n + jnp.arange(field.window + 1) for n in first)
    # Measured from the middle, so that rounding errors are small there.
    middle = (field.count - 1) / 2
    x, y = ((n - middle[k]) * field.step[k] for k, n in enumerate((column, row)))
    height = field.heights[field.row, row[:, None], column[None]]
    return _Window(field, x, y, height, covered)


def _prisms(window: _Window) -> Float[Array, "p 6 3"]:
    """Corners of the prisms, in the field's axes."""
    grid = jnp.stack([*jnp.meshgrid(window.x, window.y), window.height], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[:-1, 1:], grid[1:, 1:]
    triangles = jnp.stack([jnp.stack(t, axis=2) for t in ((a, b, d), (a, c, d))], axis=2)
    top = triangles.reshape(-1, 3, 3)
    low = jnp.full_like(top[..., :1], -window.field.base)
    return jnp.concatenate([top, jnp.concatenate([top[..., :2], low], axis=2)], axis=1)


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
