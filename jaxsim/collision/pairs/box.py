"""A sphere or a capsule against a box.

A capsule is replaced by one or two spheres at points of its segment, chosen as in MuJoCo
(`engine_collision_box.c`): the closest point to the box, and a second one if the segment lies along
a face or an edge.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsim.collision.frames import direction, tangent_of
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape

# Edges of a box in MuJoCo's order: the axis of each, and the signs of its lower corner.
_EDGE_AXIS = np.repeat(np.arange(3), 4)
_LOWER = np.array(
    [
        [2 * (corner >> k & 1) - 1 for k in range(3)]
        for axis in range(3)
        for corner in range(8)
        if not corner >> axis & 1
    ]
)
_ALONG = np.eye(3)[_EDGE_AXIS]
# The two other axes of each edge.
_ACROSS = 1 - _ALONG


def sphere_box(sphere: Shape, box: Shape) -> Contacts:
    """One contact, with the closest point of the box, or of its closest face if inside."""
    return _at_centres(sphere.pos[None], sphere.size[0], box)


def capsule_box(capsule: Shape, box: Shape) -> Contacts:
    """One contact at the closest point of the capsule's segment, and one further along it.

    The second contact is at the far end of the part of the segment that lies over the same face or
    along the same edge. A segment that points to a corner, or that has an end inside the box, has
    no second contact.
    """
    centre = box.mat.T @ (capsule.pos - box.pos)
    half = box.mat.T @ capsule.axis * capsule.size[1]
    first, second, exists = _segment_box(centre, half, box.size)
    fractions = jnp.stack([first, jnp.where(exists, second, first)])
    centres = capsule.pos[None] + fractions[:, None] * (capsule.axis * capsule.size[1])[None]
    contacts = _at_centres(centres, capsule.size[0], box)
    empty = jnp.array([False, True]) & ~exists
    return contacts.replace(dist=jnp.where(empty, INACTIVE, contacts.dist))


def _at_centres(centres: Float[Array, "k 3"], radius: Float[Array, ""], box: Shape) -> Contacts:
    """Contacts of spheres with a box."""

    def contact(centre):
        local = box.mat.T @ (centre - box.pos)
        gap, face = _closest_face(local, box.size)
        # From outside the closest point of the box, from inside the opposite of the closest face.
        towards, length = direction(jnp.clip(local, -box.size, box.size) - local, -face)
        length = jnp.where(gap < 0, gap, jnp.where(length > 0, length, gap))
        normal = box.mat @ towards
        dist = length - radius
        return dist, centre + normal * (radius + dist / 2), normal, tangent_of(normal)

    return Contacts(*jax.vmap(contact)(centres))


def _closest_face(point: Float[Array, "3"], size: Float[Array, "3"]):
    """Signed distance to the closest face's plane, and its outward normal."""
    gaps = jnp.abs(point) - size
    gap = jnp.max(gaps)
    x, y, z = gaps == gap
    chosen = jnp.stack([x, y & ~x, z & ~x & ~y])
    return gap, jnp.where(chosen, jnp.where(point > 0, 1.0, -1.0), 0.0).astype(point.dtype)


def _segment_box(
    centre: Float[Array, "3"], half: Float[Array, "3"], size: Float[Array, "3"]
) -> tuple[Float[Array, ""], Float[Array, ""], Bool[Array, ""]]:
    """Points `centre + x half` of a segment, in a box's frame, at which there are contacts.

    Returns:
      x of the closest point, x of the second point, and whether there is a second one.
    """
    end, end_square, face = _closest_end(centre, half, size)
    edge = _closest_edge(centre, half, size)
    slack = 8 * float(jnp.finfo(centre.dtype).eps) * (size @ size + half @ half)
    at_end = end_square <= edge.square + slack
    along_face, over_face = _second_over_face(end, face, centre, half, size)
    from_corner, beside_corner = _second_at_corner(edge, half, size)
    from_edge, across_edge = _second_at_edge(edge, half, size)
    step = jnp.where(edge.at_corner, from_corner, from_edge)
    exists = jnp.where(edge.at_corner, beside_corner, across_edge)
    first = jnp.where(at_end, end, edge.x)
    return first, first + jnp.where(at_end, along_face, step), jnp.where(at_end, over_face, exists)


def _closest_end(centre, half, size):
    """The closer end of the segment: x, squared distance, mask of the axis of the face below it.

    An end beyond two or three faces is closest to an edge, and its distance is set to infinity.
    """
    ends = centre[None] + jnp.array([[-1.0], [1.0]], centre.dtype) * half[None]
    beyond = jnp.abs(ends) > size[None]
    excess = jnp.where(beyond, jnp.abs(ends) - size[None], 0)
    square = jnp.where(jnp.sum(beyond, axis=1) > 1, jnp.inf, jnp.sum(excess**2, axis=1))
    upper = square[1] < square[0]
    pick = lambda pair: jnp.where(upper, pair[1], pair[0])  # noqa: E731
    return jnp.where(upper, 1.0, -1.0).astype(centre.dtype), pick(square), pick(beyond)


class _ClosestEdge:
    """The edge of the box that is closest to the segment.

    Attributes:
      square: squared distance.
      x: point of the segment, in half-lengths.
      y: point of the edge, in half-lengths.
      at_corner: whether the closest point is a corner.
      along: (3,) mask of the edge's axis.
      corner: (3,) whether the closest corner is on the upper side of each axis; the lower corner of
        the edge if the closest point is inside the edge.
    """

    def __init__(self, square, values, chosen):
        pick = lambda x: jnp.sum(jnp.where(chosen, x, 0), axis=0)  # noqa: E731
        x, y, side = (pick(v) for v in values)
        self.square, self.x, self.y = square, x, y
        self.at_corner = side != 0
        mask = chosen[:, None]
        self.along = jnp.any(mask & jnp.asarray(_ALONG > 0), axis=0)
        lower = jnp.any(mask & jnp.asarray(_LOWER > 0), axis=0)
        self.corner = lower | self.along & (side > 0)


def _closest_edge(centre, half, size) -> _ClosestEdge:
    """Closest points `centre + x half` and `corner + y e` of the segment and each of 12 edges.

    With d from the segment's centre to the edge's and c the components across the edge, the lines
    are closest at `x = c(half) . c(d) / |c(half)|^2`. Clipping as in MuJoCo: y first, then x.
    """
    along, across, lower = (jnp.asarray(x, centre.dtype) for x in (_ALONG, _ACROSS, _LOWER))
    d = across * lower * size[None] - centre[None]
    length, h_along, d_along = along @ size, along @ half, jnp.sum(along * d, axis=1)
    h_square, h_dot_d = across @ half**2, jnp.sum(across * d * half[None], axis=1)
    square = half @ half
    parallel = h_square <= 4 * float(jnp.finfo(centre.dtype).eps) ** 2 * square
    y = (h_along * h_dot_d / jnp.where(parallel, 1, h_square) - d_along) / length
    # 0 inside the edge, else the end that it is clipped to.
    side = jnp.where(y > 1, 1, jnp.where(y < -1, -1, 0))
    y = jnp.clip(y, -1, 1)
    x = (h_dot_d + h_along * (d_along + length * y)) / square
    beyond = jnp.abs(x) > 1
    x = jnp.clip(x, -1, 1)
    again = (h_along * x - d_along) / length
    side = jnp.where(beyond & (again > 1), 1, jnp.where(beyond & (again < -1), -1, side))
    y = jnp.where(beyond, jnp.clip(again, -1, 1), y)
    gap = d - half[None] * x[:, None] + along * (length * y)[:, None]
    distance = jnp.where(parallel, jnp.inf, jnp.sum(gap**2, axis=1))
    best = jnp.min(distance)
    slack = 8 * float(jnp.finfo(centre.dtype).eps) * (size @ size + square)
    near = distance <= best + slack
    first = near & (jnp.cumsum(near) == 1)
    return _ClosestEdge(best, (x, y, side), first)


def _second_over_face(end, face, centre, half, size):
    """Step from an end over a face along the segment, until it leaves the face or ends."""
    start = centre + half * end
    inward = -end * half
    step = jnp.where(inward == 0, 1, inward)
    leave = jnp.stack([(size - start) / step, (-size - start) / step])
    leave = jnp.where(face[None] | (inward == 0)[None] | (leave <= 0), 2, leave)
    return -end * jnp.minimum(jnp.min(leave), 2), jnp.any(face)


def _second_at_corner(edge: _ClosestEdge, half, size):
    """Step from a corner along the edge or over the face that the segment is closest to.

    There is no second point if the segment points towards the corner or away from it.
    """
    differs = (half > 0) ^ edge.corner
    count = jnp.sum(differs)
    odd = differs ^ (count == 2)  # the one axis that differs from the two others
    sign = jnp.where(count == 1, 1.0, -1.0).astype(half.dtype)
    room = 2 * size / _at_least_tiny(jnp.abs(half))
    along = jnp.sum(jnp.where(odd, half**2, 0)) > 0.5 * (half @ half)
    reach = jnp.where(along, 1 - sign * edge.x, 1 + sign * edge.x)
    step = jnp.minimum(reach, jnp.min(jnp.where(odd == along, room, jnp.inf)))
    return jnp.where(along, sign, -sign) * step, (count == 1) | (count == 2)


def _second_at_edge(edge: _ClosestEdge, half, size):
    """Step from inside an edge across the face that the segment is closest to, if it crosses it."""
    differs = ((half > 0) ^ edge.corner) & ~edge.along
    steep = _steeper(jnp.abs(half), edge.along)
    same = jnp.any(differs & steep)
    sign = jnp.where(same, 1.0, -1.0).astype(half.dtype)
    room = size / _at_least_tiny(jnp.abs(half))
    left = jnp.where(jnp.any((half > 0) & edge.along) == same, 1 - edge.y, 1 + edge.y)
    pick = lambda mask, x: jnp.sum(jnp.where(mask, x, 0))  # noqa: E731
    limits = 1 - sign * edge.x, 2 * pick(steep, room), left * pick(edge.along, room)
    return sign * jnp.min(jnp.stack(limits)), jnp.sum(differs) == 1


def _steeper(magnitude: Float[Array, "3"], along: Bool[Array, "3"]) -> Bool[Array, "3"]:
    """Mask of the larger of the two components that are not along the edge.

    If they are equal, it is the second in the cyclic order that begins after the edge's axis.
    """
    after, before = jnp.roll(along, 1), jnp.roll(along, 2)
    value = lambda mask: jnp.sum(jnp.where(mask, magnitude, 0))  # noqa: E731
    return jnp.where(value(after) > value(before), after, before)


def _at_least_tiny(x: Float[Array, "3"]) -> Float[Array, "3"]:
    """x, with zeros replaced by a small divisor."""
    return jnp.maximum(x, float(jnp.finfo(x.dtype).tiny) ** 0.5)
