"""Rays against triangles: all of them are tried, and the nearest one that is hit is intersected.

Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997. Which triangle is hit
has no derivative; where it is hit has.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.collision.rays.interval import Crossing


class Triangles(NamedTuple):
    """Triangles, counterclockwise from outside; one of them has no last axis.

    Components come first, so that computers work on many triangles at a time.

    Attributes:
      corner: one of the corners.
      edge1: from there to the next.
      edge2: from there to the last.
      normal: outward, of any length.
    """

    corner: Float[Array, "3 n"]
    edge1: Float[Array, "3 n"]
    edge2: Float[Array, "3 n"]
    normal: Float[Array, "3 n"]

    @classmethod
    def of(cls, corners: np.ndarray, dtype) -> "Triangles":
        """From (n, 3, 3) corners, known numbers."""
        first, second, third = (corners[:, k] for k in range(3))
        edges = second - first, third - first
        return cls(*(jnp.asarray(x.T, dtype) for x in (first, *edges, np.cross(*edges))))

    def __getitem__(self, index) -> "Triangles":
        return Triangles(*(getattr(self, name)[:, index] for name in self._fields))


def nearest_triangle(
    triangles: Triangles,
    p: Float[Array, "3 n"],
    d: Float[Array, "3 n"],
    seen: Bool[Array, "n"] | bool = True,
) -> Int[Array, ""]:
    """The first triangle that a ray hits, any for a miss.

    Args:
      triangles: n of them.
      p: where the ray starts, in the axes of each triangle.
      d: its direction.
      seen: which triangles count.
    """
    t, hit = _intersection(*lax.stop_gradient((triangles, p, d)))
    t = jnp.where(hit & seen, t, jnp.inf)
    # Compilers make two loops of numbers of this, and none of pairs as of `argmin`.
    return jnp.min(jnp.where(t == jnp.min(t), lax.iota(jnp.int32, len(t)), len(t) - 1))


def triangle_crossing(triangle: Triangles, p: Float[Array, "3"], d: Float[Array, "3"]) -> Crossing:
    """Where a ray meets one triangle."""
    t, hit = _intersection(triangle, p, d)
    return jnp.where(hit, t, jnp.inf), _dot(triangle.normal, d) > 0


def _intersection(triangles: Triangles, p, d) -> tuple[Float[Array, "*n"], Bool[Array, "*n"]]:
    """Where a ray meets the plane of each triangle, and whether that is on the triangle."""
    corner, edge1, edge2, normal = triangles
    speed = _dot(normal, d)
    parallel = speed == 0
    speed = jnp.where(parallel, 1.0, speed)
    to = corner - p
    across = _cross(to, d)
    u, v = _dot(edge2, across) / speed, -_dot(edge1, across) / speed
    # A ray through an edge must not slip between its triangles.
    slack = -8 * float(jnp.finfo(p.dtype).eps)
    t = _dot(normal, to) / speed
    hit = ~parallel & (u >= slack) & (v >= slack) & (u + v <= 1 - slack) & (t >= 0)
    return t, hit


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a, b):
    return [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]
