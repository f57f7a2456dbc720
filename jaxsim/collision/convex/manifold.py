"""Several contacts, where a face of one solid lies on a face or an edge of another.

Both facets are projected along the normal to polygons in a plane. Contacts are at the corners of
the intersection of these polygons, and their distances are those of the facets there. A face that
is inclined by more than a given angle has contacts at an edge or a corner only. The angle, the
number of contacts and the distances are MuJoCo's.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.collision.convex.solid import Facet
from jaxsim.collision.convex.solid_pair import SolidPair
from jaxsim.collision.convex.touch import Touch
from jaxsim.collision.frames import contact_frame, tangent_of
from jaxsim.collision.pairs.clipping import overlap_corners
from jaxsim.collision.spread import COSINE, SINE, levelness, one_hot, pick, spread

# Normals that differ by less than this are equal up to rounding and the error of the search.
SAME = 1e-4
# Largest difference, relative to the solids' size, of the deepest contact's distance from theirs.
CONSISTENT = 1e-3


@struct.dataclass
class Manifold:
    """Contacts of two cores, in the axes of the first and about its centre.

    Attributes:
      dist: signed distances along the normal.
      middle: points half-way between the cores.
      exists: whether each contact exists.
      normal: unit normal from the first core to the second.
    """

    dist: Float[Array, "k"]
    middle: Float[Array, "k 3"]
    exists: Bool[Array, "k"]
    normal: Float[Array, "3"]

    @classmethod
    def of(cls, touch: Touch, count: int = 1) -> "Manifold":
        """A single contact in `count` slots."""
        middle = jnp.broadcast_to((touch.first + touch.second) / 2, (count, 3))
        exists = jnp.arange(count) == 0
        return cls(jnp.broadcast_to(touch.dist, count), middle, exists, touch.normal)


def manifold(solids: SolidPair, touch: Touch, count: int) -> Manifold:
    """The contacts of facets that lie on each other, or else the single contact of `touch`."""
    first = solids.first.facet(touch.normal)
    second = _in_axes_of_first(solids, solids.second.facet(-(touch.normal @ solids.rot)))
    lies = _lies(touch.normal, first, second)
    normal = _common_normal(touch.normal, first, second)
    dist, middle, exists = _common_part(solids, first, second, normal)
    dist = jnp.where(exists, dist, jnp.inf)
    deepest = pick(one_hot(-dist), dist)
    lies = lies & (jnp.abs(deepest - touch.dist) < CONSISTENT * solids.size)
    apart = jnp.sqrt(jnp.sum((middle - pick(one_hot(-dist), middle)[None]) ** 2, axis=1))
    weight = levelness(dist - deepest, apart)
    # An inclined face touches with an edge at most: the most level one at its deepest corner.
    level = -(first.normal @ second.normal) > COSINE
    weight = jnp.where(level | (weight > jnp.max(weight) - SAME), weight, 0)
    chosen, exists = spread(middle, dist, weight, normal, count)
    # The polygon that replaces a round cap is not quite as deep as the cap, and its corners do not
    # turn with the normal: correct the distance and its derivative.
    dist = dist + jnp.where(lies, touch.dist - deepest, 0)
    dist, middle = (jnp.stack([pick(mask, x) for mask in chosen]) for x in (dist, middle))
    several = Manifold(dist, middle, exists, normal)
    one = Manifold.of(touch, count)
    return jax.tree.map(lambda x, y: jnp.where(lies, x, y), several, one)


def _in_axes_of_first(solids: SolidPair, facet: Facet) -> Facet:
    corners = solids.centre[None] + facet.corners @ solids.rot.T
    return facet.replace(corners=corners, normal=solids.rot @ facet.normal)


def _lies(normal: Float[Array, "3"], first: Facet, second: Facet) -> Bool[Array, ""]:
    """Whether one of the facets is a face orthogonal to the normal."""
    one = (normal @ first.normal > COSINE) & first.flat
    return one | (-(normal @ second.normal) > COSINE) & second.flat


def _common_normal(normal: Float[Array, "3"], first: Facet, second: Facet) -> Float[Array, "3"]:
    """The normal of a face if it equals the contact normal, because its derivative is better."""
    for facet, sign in ((second, -1), (first, 1)):
        off = facet.normal * sign - normal
        same = (off @ off < SAME**2) & facet.flat
        normal = jnp.where(same, facet.normal * sign, normal)
    return normal


def _common_part(solids: SolidPair, first: Facet, second: Facet, normal: Float[Array, "3"]):
    """Distances, middle points and existence of the corners of the projections' intersection."""
    frame = contact_frame(normal, tangent_of(normal))
    corners1, corners2 = first.corners @ frame.T, second.corners @ frame.T
    # Seen along the normal, the second's corners are clockwise.
    points, exists = overlap_corners(corners2[::-1, 1:], corners1[:, 1:], solids.size)
    lower = _height(corners1[0], frame @ first.normal, points)
    upper = _height(corners2[0], frame @ second.normal, points)
    middle = jnp.concatenate([((lower + upper) / 2)[:, None], points], axis=1) @ frame
    return upper - lower, middle, exists


def _height(corner: Float[Array, "3"], normal: Float[Array, "3"], points: Float[Array, "n 2"]):
    """Height of a plane at points; the first axis is the direction of heights."""
    upright = jnp.abs(normal[0]) > SINE
    slope = normal[1:] / jnp.where(upright, normal[0], 1)
    return corner[0] - (points - corner[None, 1:]) @ slope
