"""The normal, distance and points of two solids that touch at known features.

Which corners and pieces of surface touch is held fixed, and their geometry is solved again: this is
what has derivatives, and it is exact where the search is only close.

The corners w_i of the simplex span the directions along which the touching features extend. Two of
them: the normal is their cross product (a corner on a face, two edges). One, t, or none: the normal
is orthogonal to t, and in what is left the separation `s(n) = n . w(n)` is stationary. Its gradient
there is that part of w, its Hessian `-(C + s)`, with C the sum of the curvature radii of both
solids: one step of Newton's method. From the solution, held fixed, that step has the derivative of
the implicit function theorem, in both modes.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.collision.convex.search import BEYOND, Found, Two, Vertices
from jaxsim.collision.convex.simplex import closest_with
from jaxsim.collision.frames import direction, unit
from jaxsim.collision.spread import one_hot

# Directions and weights below these, relative to the solids' size or to one, are rounding noise.
SMALL = 1e-6
# Steps of Newton's method where there is curvature. The search leaves an error of about 1e-3; the
# last step, which has the derivatives, should begin at the solution.
STEPS = 4


@struct.dataclass
class Touch:
    """Where two solids touch, in the axes of the first and about its centre.

    Attributes:
      dist: signed distance of the cores.
      normal: from the first to the second.
      first: point of the first core.
      second: point of the second core.
    """

    dist: Float[Array, ""]
    normal: Float[Array, "3"]
    first: Float[Array, "3"]
    second: Float[Array, "3"]


@struct.dataclass
class _Span:
    """What touches: one corner of the simplex and up to two directions from it.

    Attributes:
      base: (3,) mask of the corner with the largest weight.
      others: (2, 3) masks of the corners at the ends of the directions.
      extended: (2,) which of the directions there are.
    """

    base: Bool[Array, "3"]
    others: Bool[Array, "2 3"]
    extended: Bool[Array, "2"]

    def corners(self, x: Float[Array, "3 k"]) -> tuple[Array, Array]:
        """Values at the base, and the differences of the others from them."""
        at = jnp.sum(jnp.where(self.base[:, None], x, 0), axis=0)
        ends = jnp.sum(jnp.where(self.others[..., None], x[None], 0), axis=1)
        return at, jnp.where(self.extended[:, None], ends - at[None], 0)


def touch(two: Two, found: Found) -> Touch:
    """Solve the features that were found again.

    Args:
      two: the solids.
      found: the search's result.

    Returns:
      Their touch; if another feature comes in the way, that of the search, with a fixed normal.
    """
    found = lax.stop_gradient(found)

    def step(carry, _):
        # Held fixed, the direction before the last step is that of the solution.
        n = lax.stop_gradient(carry[0])
        span = _span(two, found, n)
        return (_stationary(two, found.vertices, span, n), span), None

    start = found.normal, _Span(*(jnp.zeros(shape, bool) for shape in (3, (2, 3), 2)))
    if two.first.curved or two.second.curved:
        normal, span = lax.scan(step, start, length=STEPS)[0]
    else:
        normal, span = step(start, None)[0]
    result = _points(two, found.vertices, span, normal)
    if two.first.capped:
        result = _or_cap(two, found, result, unit(2, normal), of_first=True)
    if two.second.capped:
        result = _or_cap(two, found, result, two.rot[:, 2], of_first=False)
    return _unless_hidden(two, found, result)


def _or_cap(
    two: Two, found: Found, result: Touch, axis: Float[Array, "3"], of_first: bool
) -> Touch:
    """The touch with a flat face across an axis, where the solids are furthest apart along it.

    The corners of the simplex are on its rim, in places that mean nothing; the face is below what
    touches it.
    """
    n = jnp.where(axis @ found.normal < 0, -axis, axis)
    fixed = lax.stop_gradient(n)
    separation = fixed @ two.support(fixed).difference
    flat = lax.stop_gradient(separation > found.separation - SMALL * two.size)
    corners = _at(two, found.vertices, n)
    dist = n @ (found.weights @ corners.difference)
    first, second = found.weights @ corners.first, found.weights @ corners.second
    cap = Touch(dist, n, second - n * dist if of_first else first, second)
    cap = cap if of_first else cap.replace(second=first + n * dist)
    return jax.tree.map(lambda x, y: jnp.where(flat, x, y), cap, result)


def _unless_hidden(two: Two, found: Found, result: Touch) -> Touch:
    """The result, or where something else of a solid is in front of its features, what is.

    That has a fixed normal, and its points are the support points.
    """
    slack = SMALL * two.size
    reached = two.support(lax.stop_gradient(result.normal))
    separation = result.normal @ reached.difference
    hidden = (separation < found.separation - slack) | (separation < result.dist - slack)
    earlier = two.support(found.normal)
    better = separation > found.separation
    normal = lax.stop_gradient(jnp.where(better, result.normal, found.normal))
    first = jnp.where(better, reached.first, earlier.first)
    second = jnp.where(better, reached.second, earlier.second)
    other = Touch(normal @ (second - first), normal, first, second)
    hidden = lax.stop_gradient(hidden)
    return jax.tree.map(lambda x, y: jnp.where(hidden, x, y), other, result)


def _span(two: Two, found: Found, n: Float[Array, "3"]) -> _Span:
    """Which of the corners touch, seen from a point beyond the surface, as in the search."""
    corners = lax.stop_gradient(_at(two, found.vertices, n).difference)
    size = lax.stop_gradient(two.size)
    base = one_hot(found.weights)
    order = [jnp.roll(base, shift) for shift in range(3)]
    at, one, last = (jnp.sum(jnp.where(m[:, None], corners, 0), axis=0) for m in order)
    q = -n * jnp.maximum(BEYOND[-1] * size - n @ at, 0)
    _, weights, k = closest_with(at - q, jnp.stack([one, last, last]) - q[None])
    used = jnp.stack([jnp.where(k == 0, weights[1], 0), jnp.where(k == 0, weights[2], weights[1])])
    others = jnp.stack(order[1:])
    numbers = found.vertices.numbers
    same = jnp.all(numbers == jnp.sum(jnp.where(base[:, None], numbers, 0), axis=0)[None], axis=1)
    return _Span(base, others, (used > SMALL) & ~jnp.any(others & same[None], axis=1))


def _at(two: Two, vertices: Vertices, n: Float[Array, "3"]) -> Vertices:
    """The corners as functions of poses, sizes and normal."""
    rot = lax.stop_gradient(two.rot)
    local = (vertices.second - lax.stop_gradient(two.centre)[None]) @ rot
    points = jax.vmap(lambda x, i: two.first.point((x, i), n))
    first = points(vertices.first, vertices.numbers[:, 0])
    points = jax.vmap(lambda x, i: two.second.point((x, i), -(n @ two.rot)))
    second = points(local, vertices.numbers[:, 1])
    return vertices.replace(first=first, second=two.centre[None] + second @ two.rot.T)


def _stationary(two: Two, vertices: Vertices, span: _Span, n: Float[Array, "3"]):
    """One step to the normal of the features, from one that is close."""
    base, edges = span.corners(_at(two, vertices, n).difference)
    lengths, crossed, area, planar = _parallelogram(edges)
    facing = crossed / jnp.sqrt(jnp.where(planar, area, 1))
    facing = jnp.where(facing @ n < 0, -facing, facing)
    edge = jnp.where(lengths[0] > lengths[1], edges[0], edges[1])
    straight = edge @ edge > (SMALL * two.size) ** 2
    edge = edge / jnp.sqrt(jnp.where(straight, edge @ edge, 1))
    # First orthogonal to the edge; a curved solid touches there at another point.
    n = jnp.where(straight, direction(n - edge * (edge @ n), n)[0], n)
    base, _ = span.corners(_at(two, vertices, n).difference)
    held = lax.stop_gradient(n @ base)
    bent = jnp.where(
        straight, _across_edge(two, edge, base, n, held), _anywhere(two, base, n, held)
    )
    return jnp.where(planar, facing, bent)


def _parallelogram(edges: Float[Array, "2 3"]):
    """Squared lengths of two edges, their cross product, its square, and whether they span a plane.

    Edges that are parallel but for rounding do not.
    """
    lengths = jnp.sum(edges**2, axis=1)
    crossed = jnp.cross(edges[0], edges[1])
    area = crossed @ crossed
    eps = float(jnp.finfo(edges.dtype).eps)
    return lengths, crossed, area, area > 16 * eps * lengths[0] * lengths[1]


def _bend(two: Two, n, e):
    """The sum of both curvatures applied to e."""
    second = two.rot @ two.second.bend(-(n @ two.rot), e @ two.rot)
    return lax.stop_gradient(two.first.bend(n, e) + second)


def _across_edge(two: Two, edge, base, n, separation):
    """The normal orthogonal to an edge."""
    # It turns with the edge, whose corner may be far along it from where it touches.
    across, _ = direction(jnp.cross(edge, n), n)
    stiffness = lax.stop_gradient(across @ _bend(two, n, across)) + separation
    regular = stiffness > SMALL * two.size
    step = jnp.where(regular, base @ across / jnp.where(regular, stiffness, 1), 0)
    return direction(n + across * step, n)[0]


def _anywhere(two: Two, base, n, separation):
    """The normal where nothing but curvature restricts it."""
    u, _ = direction(jnp.cross(n, jnp.where(jnp.abs(n) < 0.6, 1, 0).astype(n.dtype)), n)
    v = jnp.cross(n, u)
    bent, other = _bend(two, n, u), _bend(two, n, v)
    a, b, c = u @ bent + separation, u @ other, v @ other + separation
    regular = (a > SMALL * two.size) & (a * c - b * b > (SMALL * two.size) ** 2)
    scale = 1 / jnp.where(regular, a * c - b * b, 1)
    x, y = (c * (base @ u) - b * (base @ v)) * scale, (a * (base @ v) - b * (base @ u)) * scale
    return direction(jnp.where(regular, n + x * u + y * v, n), n)[0]


def _points(two: Two, vertices: Vertices, span: _Span, n: Float[Array, "3"]) -> Touch:
    """The closest points of the features along a normal."""
    corners = _at(two, vertices, n)
    (base, edges), (first, ends) = (span.corners(x) for x in (corners.difference, corners.first))
    lengths, crossed, area, planar = _parallelogram(edges)
    offset = jnp.cross(base, crossed) / jnp.where(planar, area, 1)
    inside = jnp.stack([offset @ edges[1], -offset @ edges[0]])
    longer = jnp.array([True, False]) ^ (lengths[1] > lengths[0])
    straight = jnp.where(
        longer & (lengths > 0), -(edges @ base) / jnp.where(lengths > 0, lengths, 1), 0
    )
    weights = jnp.clip(jnp.where(planar, inside, straight), 0, 1)
    between, point = base + weights @ edges, first + weights @ ends
    return Touch(n @ between, n, point, point + between)
