"""`cast_ray`: the first geom on a ray."""

import functools
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.indexing import take
from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.collision.rays.height_field import height_field
from jaxsim.collision.rays.interval import Crossing
from jaxsim.collision.rays.meshes import mesh_crossing
from jaxsim.collision.rays.primitives import primitive

_HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


@struct.dataclass
class RayHit:
    """The first intersection of a ray with a geom.

    Attributes:
      distance: distance in units of the direction's length; -1 if nothing is hit.
      geom: id of the geom; -1 if nothing is hit.
      normal: outward unit normal of its surface there; zero if nothing is hit.
    """

    distance: Float[Array, ""]
    geom: Int[Array, ""]
    normal: Float[Array, "3"]


def cast_ray(
    model: Any,
    geom_xpos: Float[Array, "ngeom 3"],
    geom_xmat: Float[Array, "ngeom 3 3"],
    origin: Float[Array, "3"],
    direction: Float[Array, "3"],
    geoms: np.ndarray,
    seen: Bool[Array, "n"] | None = None,
) -> RayHit:
    """The first geom on a ray.

    Args:
      model: the model, with types and sizes of the geoms.
      geom_xpos: positions of the geoms (m).
      geom_xmat: orientations of the geoms.
      origin: start of the ray (m).
      direction: direction of the ray, of any length.
      geoms: (n,) geoms to test, static.
      seen: (n,) whether the ray can hit each of these; None for all.
    """
    seen = jnp.ones(len(geoms), bool) if seen is None else seen

    def first(origin) -> tuple[Float[Array, ""], tuple]:
        t, leaving, which = _nearest(model, geom_xpos, geom_xmat, origin, direction, geoms, seen)
        hit = jnp.isfinite(t)
        return jnp.where(hit, t, 0.0), (hit, leaving, which)

    if not len(geoms):
        return RayHit(jnp.full((), -1.0, origin.dtype), jnp.full((), -1), jnp.zeros_like(origin))
    # Moving the start parallel to the surface keeps the distance: its gradient is along the normal.
    (t, (hit, leaving, which)), gradient = jax.value_and_grad(first, has_aux=True)(origin)
    normal = jnp.where(leaving, -1.0, 1.0) * gradient / norm_and_divisor(gradient)[1]
    return RayHit(
        distance=jnp.where(hit, t, -1.0),
        geom=jnp.where(hit, which, -1),
        normal=jnp.where(hit, normal, 0.0),
    )


def _nearest(model, geom_xpos, geom_xmat, origin, direction, geoms, seen):
    """Distance, whether the ray leaves the geom there, and the geom; the first among equals."""
    pos, mat = take(geom_xpos, geoms), take(geom_xmat, geoms)
    p = jax.vmap(lambda pos, R: (origin - pos) @ R)(pos, mat)
    d = jax.vmap(lambda R: direction @ R)(mat)
    size = take(jnp.asarray(model.geom_size, origin.dtype), geoms)
    found = list(_crossings(model, geoms, size, seen, p, d))
    t, leaving, ids = (jnp.concatenate(x) for x in zip(*found, strict=True))
    best = jnp.min(lax.stop_gradient(t))
    which = jnp.min(jnp.where(t == best, ids, model.ngeom))
    chosen = jnp.argmax((t == best) & (ids == which))
    return t[chosen], leaving[chosen], which


def _crossings(model, geoms, size, seen, p, d) -> Iterator[tuple[Array, Array, Array]]:
    """Intersections with the geoms of each type; for meshes, the nearest one of all."""
    kinds = model.geom_type[geoms]
    for kind in np.unique(kinds):
        (at,) = np.nonzero(kinds == kind)
        parts = [take(x, at) for x in (size, seen, p, d)]
        if kind == _MESH:
            (t, leaving), which = mesh_crossing(model.structure.source, geoms[at], *parts)
            yield t[None], leaving[None], jnp.asarray(geoms[at])[which][None]
            continue
        if kind == _HFIELD:
            found = [_field(model, int(geoms[i]), p[i], d[i]) for i in at]
            t, leaving = (jnp.stack(x) for x in zip(*found, strict=True))
        else:
            t, leaving = jax.vmap(functools.partial(primitive, int(kind)))(parts[0], *parts[2:])
        yield jnp.where(parts[1], t, jnp.inf), leaving, jnp.asarray(geoms[at])


def _field(model, geom: int, p, d) -> Crossing:
    row = model.geom_field[geom]
    rows, columns = model.field_count[row]
    heights = jnp.asarray(model.field_height[row, :rows, :columns], p.dtype)
    return height_field(heights, model.field_size[row], p, d)
