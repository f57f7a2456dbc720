"""Rays against triangles: all are tested, and the nearest one that is hit is intersected.

Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997. The derivative holds
the triangle that is hit fixed.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.collision.rays.interval import Crossing


class Triangles(NamedTuple):
    """Triangles, counterclockwise seen from outside; a single triangle has no last axis.

    Components are the first axis, so that loops over triangles are vectorised.

    Attributes:
      corner: first corner.
      edge1: vector from it to the second corner.
      edge2: vector from it to the third corner.
      normal: outward normal, of any length.
    """

    corner: Float[Array, "3 n"]
    edge1: Float[Array, "3 n"]
    edge2: Float[Array, "3 n"]
    normal: Float[Array, "3 n"]

    @classmethod
    def of(cls, corners: np.ndarray, dtype) -> "Triangles":
        """Triangles from NumPy corners (n, 3, 3)."""
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
    """The first triangle that a ray hits; an arbitrary one if it hits none.

    Args:
      triangles: n triangles.
      p: start of the ray, in the axes of each triangle.
      d: direction of the ray.
      seen: whether the ray can hit each triangle.
    """
    t, hit = _intersection(*lax.stop_gradient((triangles, p, d)))
    t = jnp.where(hit & seen, t, jnp.inf)
    # Two reductions, which are vectorised, unlike `argmin`, a reduction of pairs.
    return jnp.min(jnp.where(t == jnp.min(t), lax.iota(jnp.int32, len(t)), len(t) - 1))


def triangle_crossing(triangle: Triangles, p: Float[Array, "3"], d: Float[Array, "3"]) -> Crossing:
    """Intersection of a ray with one triangle."""
    t, hit = _intersection(triangle, p, d)
    return jnp.where(hit, t, jnp.inf), _dot(triangle.normal, d) > 0


def _intersection(triangles: Triangles, p, d) -> tuple[Float[Array, "*n"], Bool[Array, "*n"]]:
    """Intersection of a ray with the plane of each triangle, and whether it is in the triangle."""
    corner, edge1, edge2, normal = triangles
    speed = _dot(normal, d)
    parallel = speed == 0
    speed = jnp.where(parallel, 1.0, speed)
    to = corner - p
    across = _cross(to, d)
    u, v = _dot(edge2, across) / speed, -_dot(edge1, across) / speed
    # The tolerance keeps a ray through a common edge from missing both triangles.
    slack = -8 * float(jnp.finfo(p.dtype).eps)
    t = _dot(normal, to) / speed
    hit = ~parallel & (u >= slack) & (v >= slack) & (u + v <= 1 - slack) & (t >= 0)
    return t, hit


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a, b):
    return [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]
