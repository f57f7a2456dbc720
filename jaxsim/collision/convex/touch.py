"""Normal, distance and points of two solids whose touching features are known.

The search tells which corners and parts of the surfaces touch. With these features held fixed, the
normal is computed again. This makes it differentiable, and more accurate than the search.

Differences of the simplex's corners w_i are the directions along which the touching features
extend. With two directions (a corner on a face, or two edges), the normal is their cross product.
With one direction t, or none, the normal is orthogonal to t, and the separation `s(n) = n . w(n)`
is stationary with respect to the remaining directions. Its gradient is the part of w along them,
and its Hessian is `-(C + s)`, where C is the sum of the curvature radii of both solids: this gives
a Newton step. One step from the solution, held fixed, has the derivatives that the implicit
function theorem gives, in forward and reverse mode.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.collision.convex.search import SearchResult, distances
from jaxsim.collision.convex.simplex import closest_with
from jaxsim.collision.convex.solid_pair import SolidPair, Vertices
from jaxsim.collision.frames import direction, unit
from jaxsim.collision.spread import one_hot

# Lengths (relative to the solids' size) and weights below this are rounding errors.
SMALL = 1e-6
# Newton steps for curved solids. The search has an error of about 1e-3, and the last step, which is
# differentiated, must start at the solution.
STEPS = 4


@struct.dataclass
class Touch:
    """Contact of two cores, in the axes of the first solid and relative to its centre.

    Attributes:
      dist: signed distance of the cores (m).
      normal: unit normal from the first to the second.
      first: contact point on the first core (m).
      second: contact point on the second core (m).
      numbers: numbers of the corners of both that touch, some of which may be equal.
    """

    dist: Float[Array, ""]
    normal: Float[Array, "3"]
    first: Float[Array, "3"]
    second: Float[Array, "3"]
    numbers: Int[Array, "3 2"]


@struct.dataclass
class _Span:
    """The touching features: one corner of the simplex and up to two directions from it.

    Attributes:
      base: (3,) mask of the corner with the largest weight.
      others: (2, 3) masks of the corners at the ends of the directions.
      extended: (2,) whether each direction exists.
    """

    base: Bool[Array, "3"]
    others: Bool[Array, "2 3"]
    extended: Bool[Array, "2"]

    def numbers(self, x: Int[Array, "3 k"]) -> Int[Array, "3 k"]:
        """Values of x at the corners that exist, and at the base in place of the others."""
        at = jnp.sum(jnp.where(self.base[:, None], x, 0), axis=0)
        ends = jnp.sum(jnp.where(self.others[..., None], x[None], 0), axis=1)
        return jnp.concatenate([at[None], jnp.where(self.extended[:, None], ends, at[None])])

    def corners(self, x: Float[Array, "3 k"]) -> tuple[Array, Array]:
        """Value of x at the base, and differences of the other corners' values from it."""
        at = jnp.sum(jnp.where(self.base[:, None], x, 0), axis=0)
        ends = jnp.sum(jnp.where(self.others[..., None], x[None], 0), axis=1)
        return at, jnp.where(self.extended[:, None], ends - at[None], 0)


def touch(solids: SolidPair, found: SearchResult) -> Touch:
    """Solve for the contact of the features that the search has found.

    Args:
      solids: the two solids.
      found: result of the search.

    Returns:
      The contact. If other features turn out to be in front, it is that of the search, and its
      normal has derivative zero.
    """
    found = lax.stop_gradient(found)

    def step(carry, _):
        # The last step starts from the solution, which is held fixed.
        n = lax.stop_gradient(carry[0])
        span = _span(solids, found, n)
        return (_stationary(solids, found.vertices, span, n), span), None

    start = found.normal, _Span(*(jnp.zeros(shape, bool) for shape in (3, (2, 3), 2)))
    if solids.first.curved or solids.second.curved:
        normal, span = lax.scan(step, start, length=STEPS)[0]
    else:
        normal, span = step(start, None)[0]
    result = _points(solids, found.vertices, span, normal)
    if solids.first.capped:
        result = _or_cap(solids, found, result, unit(2, normal), of_first=True)
    if solids.second.capped:
        result = _or_cap(solids, found, result, solids.rot[:, 2], of_first=False)
    return _unless_hidden(solids, found, result)


def _or_cap(
    solids: SolidPair, found: SearchResult, result: Touch, axis: Float[Array, "3"], of_first: bool
) -> Touch:
    """The contact with a flat cap, if the separation is largest along its axis, else `result`.

    The corners of the simplex are then arbitrary points on the cap's rim, so the contact point on
    the cap is the projection of the other solid's point.
    """
    n = jnp.where(axis @ found.normal < 0, -axis, axis)
    fixed = lax.stop_gradient(n)
    separation = fixed @ solids.support(fixed).difference
    flat = lax.stop_gradient(separation > found.separation - _slack(solids))
    corners = _at(solids, found.vertices, n)
    dist = n @ (found.weights @ corners.difference)
    first, second = found.weights @ corners.first, found.weights @ corners.second
    cap = Touch(dist, n, second - n * dist if of_first else first, second, result.numbers)
    cap = cap if of_first else cap.replace(second=first + n * dist)
    return jax.tree.map(lambda x, y: jnp.where(flat, x, y), cap, result)


def _unless_hidden(solids: SolidPair, found: SearchResult, result: Touch) -> Touch:
    """The result, or the support points if another feature of a solid is in front of it.

    The normal of the latter has derivative zero.
    """
    slack = _slack(solids)
    reached = solids.support(lax.stop_gradient(result.normal))
    separation = result.normal @ reached.difference
    hidden = (separation < found.separation - slack) | (separation < result.dist - slack)
    earlier = solids.support(found.normal)
    better = separation > found.separation
    normal = lax.stop_gradient(jnp.where(better, result.normal, found.normal))
    first = jnp.where(better, reached.first, earlier.first)
    second = jnp.where(better, reached.second, earlier.second)
    numbers = jnp.where(better, reached.numbers, earlier.numbers)
    numbers = jnp.broadcast_to(numbers, (3, 2))
    other = Touch(normal @ (second - first), normal, first, second, numbers)
    hidden = lax.stop_gradient(hidden)
    return jax.tree.map(lambda x, y: jnp.where(hidden, x, y), other, result)


def _slack(solids: SolidPair) -> Float[Array, ""]:
    """Differences of separations below this are rounding errors, also if one solid is small (m)."""
    return SMALL * solids.size + solids.rounding


def _span(solids: SolidPair, found: SearchResult, n: Float[Array, "3"]) -> _Span:
    """The corners of the simplex that touch, from its point closest to q as in the search."""
    corners = lax.stop_gradient(_at(solids, found.vertices, n).difference)
    size = lax.stop_gradient(solids.size)
    base = one_hot(found.weights)
    order = [jnp.roll(base, shift) for shift in range(3)]
    at, one, last = (jnp.sum(jnp.where(m[:, None], corners, 0), axis=0) for m in order)
    q = -n * jnp.maximum(distances(solids)[-1] * size - n @ at, 0)
    _, weights, k = closest_with(at - q, jnp.stack([one, last, last]) - q[None])
    # The triangle is tried twice, with `one` before `last` (k = 0) and after it (k = 2).
    first, second = weights[1:]
    of_one = jnp.where(k == 0, first, jnp.where(k == 2, second, 0))
    used = jnp.stack([of_one, jnp.where(k == 0, second, first)])
    others = jnp.stack(order[1:])
    numbers = found.vertices.numbers
    same = jnp.all(numbers == jnp.sum(jnp.where(base[:, None], numbers, 0), axis=0)[None], axis=1)
    return _Span(base, others, (used > SMALL) & ~jnp.any(others & same[None], axis=1))


def _at(solids: SolidPair, vertices: Vertices, n: Float[Array, "3"]) -> Vertices:
    """The corners as differentiable functions of poses, sizes and normal."""
    rot = lax.stop_gradient(solids.rot)
    local = (vertices.second - lax.stop_gradient(solids.centre)[None]) @ rot
    points = jax.vmap(lambda x, i: solids.first.point((x, i), n))
    first = points(vertices.first, vertices.numbers[:, 0])
    points = jax.vmap(lambda x, i: solids.second.point((x, i), -(n @ solids.rot)))
    second = points(local, vertices.numbers[:, 1])
    return vertices.replace(first=first, second=solids.centre[None] + second @ solids.rot.T)


def _stationary(solids: SolidPair, vertices: Vertices, span: _Span, n: Float[Array, "3"]):
    """One Newton step for the normal of the features, from an approximation n."""
    base, edges = span.corners(_at(solids, vertices, n).difference)
    lengths, crossed, area, planar = _parallelogram(edges)
    facing = crossed / jnp.sqrt(jnp.where(planar, area, 1))
    facing = jnp.where(facing @ n < 0, -facing, facing)
    edge = jnp.where(lengths[0] > lengths[1], edges[0], edges[1])
    straight = edge @ edge > (SMALL * solids.size) ** 2
    edge = edge / jnp.sqrt(jnp.where(straight, edge @ edge, 1))
    # Make n orthogonal to the edge; for curved solids this changes the contact point.
    n = jnp.where(straight, direction(n - edge * (edge @ n), n)[0], n)
    base, _ = span.corners(_at(solids, vertices, n).difference)
    held = lax.stop_gradient(n @ base)
    stepped = jnp.where(
        straight,
        _step_across_edge(solids, edge, base, n, held),
        _step_on_surface(solids, base, n, held),
    )
    return jnp.where(planar, facing, stepped)


def _parallelogram(edges: Float[Array, "2 3"]):
    """Squared lengths of two edges, their cross product, its square, and whether they span a plane.

    Edges that are parallel up to rounding do not span a plane.
    """
    lengths = jnp.sum(edges**2, axis=1)
    crossed = jnp.cross(edges[0], edges[1])
    area = crossed @ crossed
    eps = float(jnp.finfo(edges.dtype).eps)
    return lengths, crossed, area, area > 16 * eps * lengths[0] * lengths[1]


def _curvature_radii(solids: SolidPair, n, e):
    """The curvature radii of both solids, C in the module's docstring, applied to e."""
    second = solids.rot @ solids.second.support_derivative(-(n @ solids.rot), e @ solids.rot)
    return lax.stop_gradient(solids.first.support_derivative(n, e) + second)


def _step_across_edge(solids: SolidPair, edge, base, n, separation):
    """Newton step for a normal that is orthogonal to an edge."""
    # Taken from the edge, so that the normal turns with it, wherever along the edge `base` is.
    across, _ = direction(jnp.cross(edge, n), n)
    stiffness = lax.stop_gradient(across @ _curvature_radii(solids, n, across)) + separation
    regular = stiffness > SMALL * solids.size
    step = jnp.where(regular, base @ across / jnp.where(regular, stiffness, 1), 0)
    return direction(n + across * step, n)[0]


def _step_on_surface(solids: SolidPair, base, n, separation):
    """Newton step for a normal that only curvature determines."""
    u, _ = direction(jnp.cross(n, jnp.where(jnp.abs(n) < 0.6, 1, 0).astype(n.dtype)), n)
    v = jnp.cross(n, u)
    along_u, along_v = _curvature_radii(solids, n, u), _curvature_radii(solids, n, v)
    a, b, c = u @ along_u + separation, u @ along_v, v @ along_v + separation
    regular = (a > SMALL * solids.size) & (a * c - b * b > (SMALL * solids.size) ** 2)
    scale = 1 / jnp.where(regular, a * c - b * b, 1)
    x, y = (c * (base @ u) - b * (base @ v)) * scale, (a * (base @ v) - b * (base @ u)) * scale
    return direction(jnp.where(regular, n + x * u + y * v, n), n)[0]


def _points(solids: SolidPair, vertices: Vertices, span: _Span, n: Float[Array, "3"]) -> Touch:
    """The closest points of the features, for their normal n."""
    corners = _at(solids, vertices, n)
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
    numbers = span.numbers(vertices.numbers)
    return Touch(n @ between, n, point, point + between, numbers)
