"""Several contacts of two solids, at faces and edges that lie on each other, as in MuJoCo.

The corners that touch define a feature of each solid: a corner, an edge or a face. If two faces of
which the features are part are almost parallel, these faces are clipped; or else an edge that
starts at one feature is clipped by a face of the other, if it is almost parallel to it. MuJoCo's
rules (`multicontact` in `engine_collision_gjk.c`) say which faces and edges, where the contacts
are, and their distances and normal.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Shaped

from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.collision.convex.manifold import Manifold
from jaxsim.collision.convex.quad import clipped, widest_four
from jaxsim.collision.convex.solid import Feature
from jaxsim.collision.convex.solid_pair import SolidPair
from jaxsim.collision.convex.touch import Touch
from jaxsim.collision.frames import contact_frame, tangent_of
from jaxsim.collision.pairs.clipping import overlap_corners
from jaxsim.collision.spread import one_hot, pick

# Faces lie on each other if the cosine of the angle between their normals is below -OPPOSED, an
# edge lies on a face if the cosine of the angle to its normal is below LEVEL.
OPPOSED, LEVEL = 0.996, 0.0888
# Number of contacts.
COUNT = 4


@struct.dataclass
class _Meeting:
    """What lies on what.

    Attributes:
      faces: whether two faces lie on each other.
      edge_of_first, edge_of_second: whether an edge of one lies on a face of the other.
      face1, face2: numbers of the faces.
      normal1, normal2: their normals.
      edge: start and end of the edge.
    """

    faces: Bool[Array, ""]
    edge_of_first: Bool[Array, ""]
    edge_of_second: Bool[Array, ""]
    face1: Int[Array, ""]
    face2: Int[Array, ""]
    normal1: Float[Array, "3"]
    normal2: Float[Array, "3"]
    edge: Float[Array, "2 3"]


def face_contacts(solids: SolidPair, touch: Touch) -> Manifold:
    """Up to four contacts of faces or edges that lie on each other, or else the one of `touch`.

    The second solid has faces.
    """
    first = solids.first.feature(touch.numbers[:, 0], touch.normal)
    second = solids.second.feature(touch.numbers[:, 1], -(touch.normal @ solids.rot))
    second = _in_axes_of_first(solids, second)
    # Those that MuJoCo lists; more than four of them are thinned out.
    limit = lax.stop_gradient(jnp.asarray(solids.first.margin, touch.dist.dtype))
    meeting = _meeting(first, second, touch.dist <= limit)
    ring2, count2 = solids.second.ring(meeting.face2)
    ring2 = solids.centre[None] + ring2 @ solids.rot.T
    if solids.first.has_faces:
        ring1, _ = solids.first.ring(meeting.face1)
        faces = _between_faces(solids, meeting, ring1, (ring2, count2), limit)
        sides = max(len(ring1), len(ring2))
        ring = jnp.where(meeting.edge_of_second, *(_padded(r, sides) for r in (ring1, ring2)))
        edges = _on_edge(solids, meeting, ring, limit)
        several = jax.tree.map(lambda x, y: jnp.where(meeting.faces, x, y), faces, edges)
    else:
        # See `Segment.feature`.
        meeting = meeting.replace(edge=meeting.edge + (meeting.normal2 * limit / 2)[None])
        several = _on_edge(solids, meeting, ring2, limit)
    lies = meeting.faces | meeting.edge_of_first | meeting.edge_of_second
    lies = lies & jnp.any(several.exists)
    one = Manifold.of(touch, COUNT)
    return jax.tree.map(lambda x, y: jnp.where(lies, x, y), several, one)


def _in_axes_of_first(solids: SolidPair, feature: Feature) -> Feature:
    return feature.replace(
        normal=feature.normal @ solids.rot.T,
        corner=solids.centre + solids.rot @ feature.corner,
        ends=solids.centre[None] + feature.ends @ solids.rot.T,
    )


def _meeting(first: Feature, second: Feature, near: Bool[Array, ""]) -> _Meeting:
    facing = first.normal @ second.normal.T
    allowed = first.holds[:, None] & second.holds[None]
    opposed, face1, face2 = _least(facing, allowed)
    faces = near & (opposed < -OPPOSED)
    # An edge is tried of the solid with the smaller feature, if the other has a face there: the
    # side of a cylinder is no face.
    smaller = first.extent <= second.extent
    try_first = jnp.where(smaller, second.holds.any(), ~first.holds.any()) & (first.extent < 3)
    level1, face_of_edge1, edge1 = _first_level(first, second)
    level2, face_of_edge2, edge2 = _first_level(second, first)
    edges = near & ~faces
    of_first = edges & try_first & level1
    of_second = edges & ~try_first & (second.extent < 3) & level2
    face1 = jnp.where(of_second, face_of_edge2, face1)
    face2 = jnp.where(of_first, face_of_edge1, face2)
    start = jnp.where(of_first, first.corner, second.corner)
    end = jnp.where(of_first, pick(edge1, first.ends), pick(edge2, second.ends))
    return _Meeting(
        faces=faces,
        edge_of_first=of_first,
        edge_of_second=of_second,
        face1=pick(face1, first.number),
        face2=pick(face2, second.number),
        normal1=pick(face1, first.normal),
        normal2=pick(face2, second.normal),
        edge=jnp.stack([start, end]),
    )


def _first_level(on: Feature, below: Feature):
    """Whether an edge lies on a face, and masks of the first such face and the first such edge."""
    step = on.ends - on.corner[None]
    square = jnp.sum(step**2, axis=1)
    regular = on.along & (square > 0)
    step = step / jnp.sqrt(jnp.where(regular, square, 1))[:, None]
    level = jnp.abs(below.normal @ step.T) < LEVEL
    level = level & below.holds[:, None] & regular[None]
    return jnp.any(level), *_row_and_column(level)


def _least(x: Float[Array, "m n"], allowed: Bool[Array, "m n"]):
    """The least of the allowed elements (1 if there are none), and masks of its row and column."""
    x = jnp.where(allowed, lax.stop_gradient(x), 1)
    return jnp.min(x), *_row_and_column(-x)


def _row_and_column(x: Shaped[Array, "m n"]) -> tuple[Bool[Array, "m"], Bool[Array, "n"]]:
    """Masks of the row and the column of the largest element; the first among equals."""
    largest = one_hot(x.ravel()).reshape(x.shape)
    return jnp.any(largest, axis=1), jnp.any(largest, axis=0)


def _between_faces(solids: SolidPair, meeting: _Meeting, ring1, ring_count2, limit) -> Manifold:
    """Corners of the second face, clipped by the first, and their projections on it along n2.

    The compiler merges triangles to faces that are flat and convex up to 1e-5 m or so. Such a face
    is clipped step by step; derivatives are those of a flat one.
    """
    ring2, count2 = ring_count2
    n1, n2 = meeting.normal1, meeting.normal2
    frame = contact_frame(n1, tangent_of(n1))
    flat1, flat2 = ring1 @ frame.T, ring2 @ frame.T
    points, exists = overlap_corners(flat2[:, 1:], flat1[::-1, 1:], solids.size)
    height = _heights(flat2, frame @ n2, points, solids.rounding)
    corners = jnp.concatenate([height[:, None], points], axis=1)
    fixed = lax.stop_gradient(corners)
    uneven = jnp.any(jnp.abs((ring2 - ring2[:1]) @ n2) > solids.rounding)
    step_by_step = meeting.faces & (uneven | (jnp.sum(exists) > COUNT))

    def clip():
        flat = lax.stop_gradient((flat2, count2, flat1[:, 1:], solids.rounding))
        found, number = clipped(*flat)
        found = found, number, number >= 0
        return jax.tree.map(lambda x, y: jnp.where(step_by_step, x, y), found, at_once())

    def at_once():
        return fixed, jnp.arange(len(fixed), dtype=jnp.int32), exists

    at, number, exists = lax.cond(any_in_batch(step_by_step), clip, at_once)
    facing = n1 @ n2
    dist = lax.stop_gradient((flat1[0, 0] - at[:, 0]) * facing)
    slots, kept = _at_most_four(at, exists & meeting.faces & (dist <= limit))
    at, corners = at[slots], corners[number[slots]]
    corners = corners + lax.stop_gradient(at - corners)
    dist = (flat1[0, 0] - corners[:, 0]) * facing
    on_first = jnp.concatenate(
        [jnp.broadcast_to(flat1[:1, :1], (COUNT, 1)), corners[:, 1:]], axis=1
    )
    return Manifold(dist, on_first @ frame - n2[None] * (dist / 2)[:, None], kept, -n2)


def _sides(ring: Float[Array, "p 3"], small: Float[Array, ""]) -> Float[Array, "p 3"]:
    """Vectors along the sides of a face; those not longer than `small` are padding, and zero.

    Corners that are equal may be rounded apart, if products are fused with sums.
    """
    side = jnp.roll(ring, -1, axis=0) - ring
    return jnp.where(jnp.sum(side**2, axis=1, keepdims=True) > small**2, side, 0)


def _heights(
    ring: Float[Array, "p 3"],
    normal: Float[Array, "3"],
    points: Float[Array, "n 2"],
    small: Float[Array, ""],
):
    """Heights of a face at points, of which the first p are on its sides, one each.

    The height is the first coordinate.
    """
    step = _sides(ring, small)
    square = jnp.sum(step[:, 1:] ** 2, axis=1)
    along = jnp.sum((points[: len(ring)] - ring[:, 1:]) * step[:, 1:], axis=1)
    on_sides = ring[:, 0] + along / jnp.where(square > 0, square, 1) * step[:, 0]
    upright = jnp.where(normal[0] == 0, 1, normal[0])
    inside = ring[0, 0] - (points[len(ring) :] - ring[:1, 1:]) @ normal[1:] / upright
    return jnp.concatenate([on_sides, inside])


def _at_most_four(points, exists):
    """Numbers of four corners, and whether each exists."""
    number = jnp.sum(exists)
    rank = jnp.cumsum(exists) - 1
    chosen = jnp.stack([one_hot(exists & (rank == k)) for k in range(COUNT)])
    some = jnp.sum(jnp.where(chosen, jnp.arange(len(points)), 0), axis=1, dtype=jnp.int32)

    def widest():
        return jnp.where(number > COUNT, widest_four(points, exists).astype(jnp.int32), some)

    numbers = lax.cond(any_in_batch(number > COUNT), widest, lambda: some)
    return numbers, jnp.arange(COUNT) < number


def _on_edge(solids: SolidPair, meeting: _Meeting, ring, limit) -> Manifold:
    """The ends of an edge, clipped by the sides of a face; a cut end counts twice if alone."""
    normal = jnp.where(meeting.edge_of_second, meeting.normal1, meeting.normal2)
    begin, end = _within(meeting.edge, ring, normal, solids.rounding)
    step = meeting.edge[1] - meeting.edge[0]
    ends = meeting.edge[:1] + jnp.stack([begin, end])[:, None] * step[None]
    dist = (ends - ring[:1]) @ normal
    below = (begin < end) & (lax.stop_gradient(dist) <= limit)
    cut = jnp.stack([begin > 0, end < 1])
    take = jnp.where(below, jnp.arange(2), jnp.arange(2)[::-1])[jnp.array([0, 1, 1, 1])]
    dist, ends = dist[take], ends[take]
    twice = below.all() | (below & cut).any()
    exists = jnp.stack([below.any(), twice, *(jnp.zeros((), bool),) * 2])
    middle = ends - normal[None] * (dist / 2)[:, None]
    return Manifold(dist, middle, exists, jnp.where(meeting.edge_of_second, normal, -normal))


def _padded(ring: Float[Array, "p 3"], sides: int) -> Float[Array, "{sides} 3"]:
    return jnp.concatenate([ring, jnp.repeat(ring[-1:], sides - len(ring), axis=0)])


def _within(
    edge: Float[Array, "2 3"],
    ring: Float[Array, "p 3"],
    normal: Float[Array, "3"],
    small: Float[Array, ""],
):
    """The part of an edge above or below a face (Cyrus and Beck, 1978), as fractions of it."""
    inward = jnp.cross(_sides(ring, small), normal[None])
    from_start, from_end = (jnp.sum(inward * (x[None] - ring), axis=1) for x in edge)
    rise = from_end - from_start
    crossing = -from_start / jnp.where(rise != 0, rise, 1)
    begin = jnp.max(jnp.where(rise > 0, crossing, 0), initial=0)
    end = jnp.min(jnp.where(rise < 0, crossing, 1), initial=1)
    outside = jnp.any((from_start < 0) & (from_end < 0))
    return begin, jnp.where(outside, begin - 1, end)
