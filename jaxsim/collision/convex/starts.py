"""Directions from which the search for the largest separation of two solids starts."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxsim.collision.convex.solid import Planes
from jaxsim.collision.convex.solid_pair import SolidPair
from jaxsim.collision.frames import direction
from jaxsim.collision.spread import one_hot, pick

# Of each CHUNK of faces the best is returned.
CHUNK = 16


def axis_starts(solids: SolidPair) -> Float[Array, "16 3"]:
    """Line of centres, axes of both solids and their cross products."""
    axes1, axes2 = jnp.eye(3, dtype=solids.rot.dtype), solids.rot.T
    crossed = jnp.cross(axes1[:, None], axes2[None]).reshape(9, 3)
    line, _ = direction(solids.centre, axes1[2])
    square = jnp.sum(crossed**2, axis=1)
    regular = square > 1e-6
    crossed = crossed / jnp.sqrt(jnp.where(regular, square, 1))[:, None]
    crossed = jnp.where(regular[:, None], crossed, line[None])
    guesses = jnp.concatenate([line[None], axes1, axes2, crossed])
    return jnp.where((guesses @ solids.centre < 0)[:, None], -guesses, guesses)


def face_starts(solids: SolidPair) -> Float[Array, "n 3"] | None:
    """Normals of the faces of two polytopes along which their separation is probably large.

    The separation along the normal of a face is the height above its plane of the other solid's
    lowest corner. Of a large solid only some corners are tried.

    Returns:
      Directions from the first solid to the second; None if the solids do not have such faces.
    """
    first, second = solids.first, solids.second
    if not (first.faceted and second.faceted):
        return None
    found = []
    if planes := first.planes():
        corners = solids.centre[None] + second.some_corners() @ solids.rot.T
        found.append(_lowest_penetrated(planes, corners))
    if planes := second.planes():
        corners = (first.some_corners() - solids.centre[None]) @ solids.rot
        found.append(-_lowest_penetrated(planes, corners) @ solids.rot.T)
    return jnp.concatenate(found) if found else None


def _lowest_penetrated(planes: Planes, corners: Float[Array, "k 3"]) -> Float[Array, "c 3"]:
    """Of each chunk of planes, the normal of the one that corners are least below."""
    # All of them: faces of a rounded hull differ by a few degrees, and have maxima of their own.
    number = len(planes.normal)
    tried = np.arange(-(-number // CHUNK) * CHUNK).clip(max=number - 1).reshape(-1, CHUNK)
    chunks = jax.tree.map(lambda x: x[tried], planes)

    def best(chunk: Planes):
        height = jnp.min(chunk.normal @ corners.T, axis=1) - chunk.offset
        return pick(one_hot(height), chunk.normal)

    # One chunk after the other, for memory.
    return lax.map(best, chunks)
