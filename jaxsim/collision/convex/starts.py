"""Directions from which the search for the largest separation of two solids starts."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxsim.collision.convex.solid import Planes, Solid
from jaxsim.collision.convex.solid_pair import SolidPair
from jaxsim.collision.frames import direction
from jaxsim.collision.spread import one_hot, pick

# Of each CHUNK of faces the best is returned; at most CHUNK of these are treated at a time.
CHUNK = 16


def axis_starts(solids: SolidPair) -> Float[Array, "n 3"]:
    """Line of centres, axes of both solids and their cross products."""
    axes1, axes2 = solids.first.axes(), solids.second.axes() @ solids.rot.T
    crossed = jnp.cross(axes1[:, None], axes2[None]).reshape(-1, 3)
    line, _ = direction(solids.centre, axes1[2])
    square = jnp.sum(crossed**2, axis=1)
    regular = square > 1e-6
    crossed = crossed / jnp.sqrt(jnp.where(regular, square, 1))[:, None]
    crossed = jnp.where(regular[:, None], crossed, line[None])
    guesses = jnp.concatenate([line[None], axes1, axes2, crossed])
    return jnp.where((guesses @ solids.centre < 0)[:, None], -guesses, guesses)


def face_starts(solids: SolidPair) -> tuple[Float[Array, "n 3"], Float[Array, "n"]] | None:
    """Normals of the faces of polytopes along which the separation is probably large.

    The separation along the normal of a face is the height above its plane of the other solid's
    lowest point. Of a large polytope only some corners are tried to choose the faces.

    Returns:
      Directions from the first solid to the second, and the separations along them (m); None if
      neither has such faces.
    """
    first, second, found = solids.first, solids.second, []
    if planes := _planes(first):
        place = lambda x: solids.centre[None] + x @ solids.rot.T  # noqa: E731
        found.append(_least_penetrated(planes, second, solids.rot, place))
    if planes := _planes(second):
        place = lambda x: (x - solids.centre[None]) @ solids.rot  # noqa: E731
        normal, height = _least_penetrated(planes, first, solids.rot.T, place)
        found.append((-normal @ solids.rot.T, height))
    if not found:
        return None
    normal, height = zip(*found, strict=True)
    return jnp.concatenate(normal), jnp.concatenate(height)


def _planes(solid: Solid) -> Planes | None:
    return solid.planes() if solid.faceted else None


def _in_chunks(number: int) -> np.ndarray:
    """Numbers of faces as (m, k, CHUNK), m rows of at most CHUNK chunks; the last is repeated."""
    chunks = -(-number // CHUNK)
    rows = -(-chunks // CHUNK)
    shape = rows, -(-chunks // rows), CHUNK
    return np.arange(np.prod(shape)).clip(max=number - 1).reshape(shape)


def _least_penetrated(
    planes: Planes,
    other: Solid,
    rot: Float[Array, "3 3"],
    place: Callable[[Float[Array, "k 3"]], Float[Array, "k 3"]],
) -> tuple[Float[Array, "c 3"], Float[Array, "c"]]:
    """Of each chunk of planes, the normal of the one that another solid is least below.

    Args:
      planes: planes of the faces of a polytope.
      other: the other solid.
      rot: its axes, as columns, in those of the polytope.
      place: from its points to the same in the polytope's axes.

    Returns:
      The normals, and the heights of the solid's lowest points above their planes (m).
    """
    # All of them: faces of a rounded hull differ by a few degrees, and have maxima of their own.
    chunks = jax.tree.map(lambda x: x[_in_chunks(len(planes.normal))], planes)
    some, corners = (
        (place(other.some_corners()), place(other.corner)) if other.faceted else (None, None)
    )

    def lowest(normal, corners):
        if corners is not None:
            return jnp.min(normal @ corners.T, axis=1)
        reached, _ = jax.vmap(other.support)(-(normal @ rot))
        return jnp.sum(normal * place(reached), axis=1)

    def best(row: Planes):
        height = lowest(row.normal.reshape(-1, 3), some).reshape(row.offset.shape) - row.offset
        chosen = jax.vmap(one_hot)(height)
        normal, offset = (jax.vmap(pick)(chosen, x) for x in (row.normal, row.offset))
        return normal, lowest(normal, corners) - offset

    # One row after the other, for memory.
    normal, height = lax.map(best, chunks)
    return normal.reshape(-1, 3), height.reshape(-1)
