"""Rays against triangles: all of them are tried, and the nearest one that is hit is intersected.

Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997. Which triangle is hit
has no derivative; where it is hit has.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.collision.rays.interval import Crossing


class Triangles(NamedTuple):
    """Triangles by a corner and the two edges that begin there, counterclockwise from outside."""

    corner: Float[Array, "n 3"]
    edge1: Float[Array, "n 3"]
    edge2: Float[Array, "n 3"]
    normal: Float[Array, "n 3"]

    @classmethod
    def of(cls, corners: np.ndarray, dtype) -> "Triangles":
        """From (n, 3, 3) corners, known numbers."""
        first, second, third = (corners[:, k] for k in range(3))
        edges = second - first, third - first
        parts = (first, *edges, np.cross(*edges))
        return cls(*(jnp.asarray(part, dtype) for part in parts))


def nearest_triangle(
    triangles: Triangles,
    p: Float[Array, "n 3"],
    d: Float[Array, "n 3"],
    seen: Bool[Array, "n"] | bool = True,
) -> Int[Array, ""]:
    """The first triangle that a ray hits, any for a miss.

    Args:
      triangles: n of them.
      p: where the ray starts, in the axes of each triangle.
      d: its direction.
      seen: which triangles count.
    """
    t, hit = jax.vmap(_intersection)(*lax.stop_gradient((triangles, p, d)))
    return jnp.argmin(jnp.where(hit & seen, t, jnp.inf))


def triangle_crossing(triangle: Triangles, p: Float[Array, "3"], d: Float[Array, "3"]) -> Crossing:
    """Where a ray meets one triangle."""
    t, hit = _intersection(triangle, p, d)
    return jnp.where(hit, t, jnp.inf), triangle.normal @ d > 0


def _intersection(triangle: Triangles, p, d) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    corner, edge1, edge2, normal = triangle
    speed = normal @ d
    parallel = speed == 0
    speed = jnp.where(parallel, 1.0, speed)
    to = corner - p
    across = jnp.cross(to, d)
    u, v = edge2 @ across / speed, -(edge1 @ across) / speed
    # A ray through an edge must not slip between its triangles.
    slack = -8 * float(jnp.finfo(p.dtype).eps)
    t = normal @ to / speed
    hit = ~parallel & (u >= slack) & (v >= slack) & (u + v <= 1 - slack) & (t >= 0)
    return t, hit
