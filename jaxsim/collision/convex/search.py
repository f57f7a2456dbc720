"""Where two convex solids touch: the direction along which they are furthest apart.

With support points a(n) of the first solid along n and b(n) of the second along -n, the separation
along a unit vector n is `s(n) = n . (b - a)`, and the signed distance is the largest separation:
positive between disjoint solids, minus the depth between overlapping ones. b - a is a support point
of the Minkowski difference, so this is about its point closest to the origin.

Seen from a point outside, q = -tau n with tau > -s(n), the closest point of the difference is found
by the algorithm of Gilbert, Johnson and Keerthi (1988), one support point at a time. The direction
n' to it from q is no worse than n: `s(n') + tau n . n' >= s(n) + tau`. So each step is followed by
a move of q to the best direction that is known. tau is at least a fraction of the solids' size
beyond the surface: the closest point is then never at q, the simplex has at most three corners, and
float32 has a direction to it, however close the solids are to touching. The fraction shrinks; at
first it smooths the landscape.

For disjoint solids the best direction is unique. For overlapping ones there may be others, so deep
ones are begun from several.
"""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.collision.convex.simplex import closest_with
from jaxsim.collision.convex.solid import Solid
from jaxsim.collision.frames import direction
from jaxsim.collision.spread import one_hot, pick

# Steps of the search: how far q is beyond the surface, in sizes of the smaller solid.
BEYOND = (0.4,) * 6 + (0.04,) * 6
# Overlaps deeper than this, in the same unit, are begun from so many more directions, whose cosines
# with each other are below the last number.
DEEP, STARTS, DIFFERENT = 0.01, 4, 0.95


@struct.dataclass
class Vertices:
    """Support points of both solids, in the first one's axes and about its centre.

    Attributes:
      first: points of the first solid.
      second: points of the second.
      numbers: of both, see `Solid.support`.
    """

    first: Float[Array, "*k 3"]
    second: Float[Array, "*k 3"]
    numbers: Int[Array, "*k 2"]

    @property
    def difference(self) -> Float[Array, "*k 3"]:
        """Points of the Minkowski difference."""
        return self.second - self.first


@struct.dataclass
class Found:
    """The result of the search.

    Attributes:
      separation: along the best direction.
      normal: that direction, from the first solid to the second.
      vertices: (3,) corners of the simplex that is closest.
      weights: of the closest point on them; zero where fewer than three are needed.
    """

    separation: Float[Array, ""]
    normal: Float[Array, "3"]
    vertices: Vertices
    weights: Float[Array, "3"]


class Two:
    """Two solids in the axes of the first.

    Attributes:
      first, second: the solids.
      rot: (3, 3) columns are the axes of the second.
      centre: (3,) centre of the second.
    """

    def __init__(self, first: Solid, second: Solid):
        self.first, self.second = first, second
        here, there = first.shape, second.shape
        self.rot = here.mat.T @ there.mat
        self.centre = here.mat.T @ (there.pos - here.pos)

    def support(self, n: Float[Array, "3"]) -> Vertices:
        """Support points along n."""
        a, number1 = self.first.support(n)
        b, number2 = self.second.support(-(n @ self.rot))
        return Vertices(a, self.centre + self.rot @ b, jnp.stack([number1, number2]))

    @property
    def size(self) -> Float[Array, ""]:
        """A length to which others are small or large."""
        return jnp.minimum(self.first.reach, self.second.reach)


def search(two: Two) -> Found:
    """The direction of the largest separation; it has no derivatives."""
    guesses = _guesses(two)
    values, _ = jax.vmap(lambda n: _separation(two, n))(guesses)

    def attempt(carry, count):
        found, taken = carry
        n = pick(one_hot(jnp.where(taken, -jnp.inf, values)), guesses)
        wanted = (count == 0) | (found.separation < -DEEP * two.size)
        # A batch in which nothing is deep is spared the rest; the others' results do not change.
        other = lax.cond(any_in_batch(wanted), lambda: _climb(two, n), lambda: found)
        better = wanted & (other.separation > found.separation)
        found = jax.tree.map(lambda x, y: jnp.where(better, x, y), other, found)
        return (
            found,
            taken | (guesses @ n > DIFFERENT) | (guesses @ found.normal > DIFFERENT),
        ), None

    start = _start(two, guesses[0]).replace(separation=-jnp.inf * jnp.ones_like(values[0]))
    taken = jnp.zeros(len(guesses), bool)
    return lax.scan(attempt, (start, taken), jnp.arange(1 + STARTS))[0][0]


def _start(two: Two, n: Float[Array, "3"]) -> Found:
    value, vertex = _separation(two, n)
    corners = jax.tree.map(lambda x: jnp.stack([x, x, x]), vertex)
    return Found(value, n, corners, jnp.array([1.0, 0, 0], n.dtype))


def _separation(two: Two, n: Float[Array, "3"]) -> tuple[Float[Array, ""], Vertices]:
    vertices = two.support(n)
    return n @ vertices.difference, vertices


def _guesses(two: Two) -> Float[Array, "16 3"]:
    """The line of centres, the axes of both and their cross products, towards the second solid."""
    axes1, axes2 = jnp.eye(3, dtype=two.rot.dtype), two.rot.T
    crossed = jnp.cross(axes1[:, None], axes2[None]).reshape(9, 3)
    line, _ = direction(two.centre, axes1[2])
    square = jnp.sum(crossed**2, axis=1)
    regular = square > 1e-6
    crossed = crossed / jnp.sqrt(jnp.where(regular, square, 1))[:, None]
    crossed = jnp.where(regular[:, None], crossed, line[None])
    guesses = jnp.concatenate([line[None], axes1, axes2, crossed])
    return jnp.where((guesses @ two.centre < 0)[:, None], -guesses, guesses)


def _climb(two: Two, n: Float[Array, "3"]) -> Found:
    """From one direction to a locally best one."""
    beyond = jnp.asarray(np.array(BEYOND), n.dtype) * two.size
    return lax.scan(lambda found, x: (_step(two, found, x), None), _start(two, n), beyond)[0]


def _step(two: Two, found: Found, beyond: Float[Array, ""]) -> Found:
    """One more support point, in the direction of the closest point of the simplex from q."""
    q = -found.normal * jnp.maximum(beyond - found.separation, 0)
    old = found.vertices.difference - q[None]
    # The corners are the same, but q has moved.
    closest, _, _ = closest_with(old[0], jnp.stack([old[1], old[2], old[2]]))
    n, _ = direction(closest, found.normal)
    value, new = _separation(two, n)
    better = value > found.separation
    _, weights, k = closest_with(new.difference - q, old)
    vertices = jax.tree.map(lambda x, y: _corners(x, y, k), new, found.vertices)
    return Found(
        jnp.where(better, value, found.separation),
        jnp.where(better, n, found.normal),
        vertices,
        weights,
    )


def _corners(new: Array, old: Array, k: Int[Array, ""]) -> Array:
    """The new corner and the old ones k and k + 1."""
    following = jnp.where(k == 0, old[1], jnp.where(k == 1, old[2], old[0]))
    chosen = jnp.where(k == 0, old[0], jnp.where(k == 1, old[1], old[2]))
    return jnp.stack([new, chosen, following])
