"""Search for the direction of the largest separation of two convex solids.

With support points a(n) of the first solid along n and b(n) of the second along -n, the separation
along a unit vector n is `s(n) = n . (b - a)`. The signed distance is the largest separation:
positive for disjoint solids, minus the penetration depth for overlapping ones. b - a is a support
point of the Minkowski difference, so the problem is to find its point closest to the origin.

The algorithm of Gilbert, Johnson and Keerthi (1988) finds the point of the difference closest to a
point q outside of it, one support point at a time. Here q = -tau n with tau > -s(n). The direction
n' from q to that point is at least as good as n: `s(n') + tau n . n' >= s(n) + tau`. So after each
step q moves to the best direction so far. q is outside by at least a fraction of the solids' size.
Then the closest point is never q itself, the simplex has at most three corners, and the direction
is accurate in float32, however close the solids are. The fraction shrinks during the search; large
fractions smooth s(n).

For disjoint solids the best direction is unique. For overlapping solids s(n) may have several local
maxima, so the search for deep ones starts from several directions.
"""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.collision.convex.simplex import closest_with
from jaxsim.collision.convex.solid_pair import SolidPair, Vertices
from jaxsim.collision.convex.starts import axis_starts, face_starts
from jaxsim.collision.frames import direction
from jaxsim.collision.spread import one_hot, pick

# Distance of q from the surface in each step of the search, in sizes of the smaller solid.
BEYOND = (0.4,) * 3 + (0.04,) * 4 + (0.01,) * 5
# More for solids with round caps: along a line of a cylinder's side that is almost level, support
# points jump from end to end.
CAPPED = (0.01,) * 4
# More for solids with edges: from further away, the search may end beside the corners that touch.
EDGED = (0.001,) * 4
# More for solids with MANY corners: from further away, faces that hardly differ look the same.
FINE, MANY = (0.001,) * 4, 128
# For overlaps deeper than DEEP, in the same unit, the search starts from STARTS more directions,
# whose cosines with each other are below DIFFERENT.
DEEP, STARTS, DIFFERENT = 0.01, 4, 0.95


@struct.dataclass
class SearchResult:
    """The result of the search.

    Attributes:
      separation: separation along the best direction.
      normal: the best direction, from the first solid to the second.
      vertices: (3,) corners of the last simplex.
      weights: barycentric coordinates of its closest point; zero for corners that are not needed.
    """

    separation: Float[Array, ""]
    normal: Float[Array, "3"]
    vertices: Vertices
    weights: Float[Array, "3"]


def search(solids: SolidPair) -> SearchResult:
    """Find the direction of the largest separation; the result has no derivatives."""
    guesses = axis_starts(solids)
    values, _ = jax.vmap(lambda n: _separation(solids, n))(guesses)
    found = _climb(solids, pick(one_hot(values), guesses))
    deep = found.separation < -DEEP * solids.size
    # Skipped if no environment of the batch needs it.
    other = lax.cond(
        any_in_batch(deep), lambda: _climb_more(solids, found, guesses, values), lambda: found
    )
    return jax.tree.map(lambda x, y: jnp.where(deep, x, y), other, found)


def _climb_more(solids: SolidPair, found: SearchResult, guesses, values) -> SearchResult:
    """The best of some more searches from good directions that differ from those before."""
    if faces := face_starts(solids):
        normals, heights = faces
        guesses, values = jnp.concatenate([guesses, normals]), jnp.concatenate([values, heights])

    def attempt(carry, _):
        found, tried = carry
        near = (guesses @ found.normal > DIFFERENT) & (values <= found.separation)
        n = pick(one_hot(jnp.where(tried | near, -jnp.inf, values)), guesses)
        other = _climb(solids, n)
        better = other.separation > found.separation
        found = jax.tree.map(lambda x, y: jnp.where(better, x, y), other, found)
        return (found, tried | (guesses @ n > DIFFERENT)), None

    return lax.scan(attempt, (found, values > jnp.inf), length=STARTS)[0][0]


def distances(solids: SolidPair) -> tuple[float, ...]:
    """Distances of q from the surface in each step, in sizes of the smaller solid."""
    both = solids.first, solids.second
    capped, faceted = any(s.capped for s in both), any(s.faceted for s in both)
    many = any(s.faceted and len(s.corner) > MANY for s in both)
    steps = BEYOND + (CAPPED if capped else ()) + (EDGED if capped or faceted else ())
    return steps + (FINE if many else ())


def _start(solids: SolidPair, n: Float[Array, "3"]) -> SearchResult:
    value, vertex = _separation(solids, n)
    corners = jax.tree.map(lambda x: jnp.stack([x, x, x]), vertex)
    return SearchResult(value, n, corners, jnp.array([1.0, 0, 0], n.dtype))


def _separation(solids: SolidPair, n: Float[Array, "3"]) -> tuple[Float[Array, ""], Vertices]:
    vertices = solids.support(n)
    return n @ vertices.difference, vertices


def _climb(solids: SolidPair, n: Float[Array, "3"]) -> SearchResult:
    """Search for a local maximum of the separation, starting from n."""
    beyond = jnp.asarray(np.array(distances(solids)), n.dtype) * solids.size
    return lax.scan(lambda found, x: (_step(solids, found, x), None), _start(solids, n), beyond)[0]


def _step(solids: SolidPair, found: SearchResult, beyond: Float[Array, ""]) -> SearchResult:
    """One step: a new support point in the direction from q to the simplex's closest point."""
    q = -found.normal * jnp.maximum(beyond - found.separation, 0)
    old = found.vertices.difference - q[None]
    # q has moved since the last step, so the closest point of the simplex is computed again.
    closest, _, _ = closest_with(old[0], jnp.stack([old[1], old[2], old[2]]))
    n, _ = direction(closest, found.normal)
    value, new = _separation(solids, n)
    better = value > found.separation
    _, weights, k = closest_with(new.difference - q, old)
    vertices = jax.tree.map(lambda x, y: _corners(x, y, k), new, found.vertices)
    return SearchResult(
        jnp.where(better, value, found.separation),
        jnp.where(better, n, found.normal),
        vertices,
        weights,
    )


def _corners(new: Array, old: Array, k: Int[Array, ""]) -> Array:
    """The new corner and the old corners k and k + 1 (mod 3)."""
    following = jnp.where(k == 0, old[1], jnp.where(k == 1, old[2], old[0]))
    chosen = jnp.where(k == 0, old[0], jnp.where(k == 1, old[1], old[2]))
    return jnp.stack([new, chosen, following])
