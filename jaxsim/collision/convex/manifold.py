"""Several contacts where a face of one solid lies on a face or a straight line of another.

Both facets are seen along the normal, as polygons in a plane. A contact is at a corner of their
common part, and its distance is that of the facets there. A face that leans away from the deepest
contact at more than an angle touches with an edge or a corner only. Angle, number of contacts and
distances are MuJoCo's.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.collision.convex.search import Two
from jaxsim.collision.convex.solid import Facet
from jaxsim.collision.convex.touch import Touch
from jaxsim.collision.frames import contact_frame, tangent_of
from jaxsim.collision.pairs.clipping import overlap_corners
from jaxsim.collision.spread import COSINE, SINE, levelness, one_hot, pick, spread

# Normals closer to each other than this are the same, but for rounding and the search's error.
SAME = 1e-4
# The deepest contact must have the distance of the solids, relative to their size.
CONSISTENT = 1e-3


@struct.dataclass
class Manifold:
    """Contacts of two cores, in the axes of the first and about its centre.

    Attributes:
      dist: signed distances along the normal.
      middle: points half-way between the cores.
      exists: which of the contacts there are.
      normal: from the first to the second.
    """

    dist: Float[Array, "k"]
    middle: Float[Array, "k 3"]
    exists: Bool[Array, "k"]
    normal: Float[Array, "3"]

    @classmethod
    def of(cls, touch: Touch, count: int = 1) -> "Manifold":
        """A single contact, among `count` places."""
        middle = jnp.broadcast_to((touch.first + touch.second) / 2, (count, 3))
        exists = jnp.arange(count) == 0
        return cls(jnp.broadcast_to(touch.dist, count), middle, exists, touch.normal)


def manifold(two: Two, touch: Touch, count: int) -> Manifold:
    """The contacts of facets that lie on each other, or else the single one."""
    first = two.first.facet(touch.normal)
    second = _in_axes_of_first(two, two.second.facet(-(touch.normal @ two.rot)))
    lies = _lies(touch.normal, first, second)
    normal = _common_normal(touch.normal, first, second)
    dist, middle, exists = _common_part(two, first, second, normal)
    dist = jnp.where(exists, dist, jnp.inf)
    deepest = jnp.min(dist)
    lies = lies & (jnp.abs(deepest - touch.dist) < CONSISTENT * two.size)
    apart = jnp.sqrt(jnp.sum((middle - pick(one_hot(-dist), middle)[None]) ** 2, axis=1))
    weight = levelness(dist - deepest, apart)
    # A face that leans touches with an edge at most: the most level one from its deepest corner.
    level = -(first.normal @ second.normal) > COSINE
    weight = jnp.where(level | (weight > jnp.max(weight) - SAME), weight, 0)
    chosen, exists = spread(middle, dist, weight, normal, count)
    exists = exists & (level | (jnp.arange(count) < 2))
    # Where a round cap is clipped, the polygon that stands for it is not quite deep enough.
    dist = dist + lax.stop_gradient(jnp.where(lies, touch.dist - deepest, 0))
    dist, middle = (jnp.stack([pick(mask, x) for mask in chosen]) for x in (dist, middle))
    several = Manifold(dist, middle, exists, normal)
    one = Manifold.of(touch, count)
    return jax.tree.map(lambda x, y: jnp.where(lies, x, y), several, one)


def _in_axes_of_first(two: Two, facet: Facet) -> Facet:
    corners = two.centre[None] + facet.corners @ two.rot.T
    return facet.replace(corners=corners, normal=two.rot @ facet.normal)


def _lies(normal: Float[Array, "3"], first: Facet, second: Facet) -> Bool[Array, ""]:
    """Whether one of the facets is a face across the normal."""
    one = (normal @ first.normal > COSINE) & first.flat
    return one | (-(normal @ second.normal) > COSINE) & second.flat


def _common_normal(normal: Float[Array, "3"], first: Facet, second: Facet) -> Float[Array, "3"]:
    """That of a face if it is the same: it has the better derivatives."""
    for facet, sign in ((second, -1), (first, 1)):
        off = facet.normal * sign - normal
        same = (off @ off < SAME**2) & facet.flat
        normal = jnp.where(same, facet.normal * sign, normal)
    return normal


def _common_part(two: Two, first: Facet, second: Facet, normal: Float[Array, "3"]):
    """Distances and middles at the corners of the common part, and which of them are corners."""
    frame = contact_frame(normal, tangent_of(normal))
    corners1, corners2 = first.corners @ frame.T, second.corners @ frame.T
    # Seen along the normal, the second's corners are clockwise.
    points, exists = overlap_corners(corners2[::-1, 1:], corners1[:, 1:], two.size)
    lower = _height(corners1[0], frame @ first.normal, points)
    upper = _height(corners2[0], frame @ second.normal, points)
    middle = jnp.concatenate([((lower + upper) / 2)[:, None], points], axis=1) @ frame
    return upper - lower, middle, exists


def _height(corner: Float[Array, "3"], normal: Float[Array, "3"], points: Float[Array, "n 2"]):
    """Of a plane over points; axes are the direction of heights and two others."""
    upright = jnp.abs(normal[0]) > SINE
    slope = normal[1:] / jnp.where(upright, normal[0], 1)
    return corner[0] - (points - corner[None, 1:]) @ slope
