"""Distances and nearest points of geoms that may be far apart."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.collision.candidates import PairGroup
from jaxsim.collision.contact import ContactKind
from jaxsim.collision.convex import Box, Cylinder, Ellipsoid, Polytope, Segment, convex_pair
from jaxsim.collision.convex.round import Point
from jaxsim.collision.evaluation import pair_contacts
from jaxsim.collision.shapes import Contacts, Shape
from jaxsim.collision.table import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HFIELD,
    MESH,
    PAIRS,
    PLANE,
    SPHERE,
)

_SOLIDS = {
    SPHERE: Point,
    CAPSULE: Segment,
    ELLIPSOID: Ellipsoid,
    CYLINDER: Cylinder,
    BOX: Box,
    MESH: Polytope,
}
_CLOSED = {
    *((PLANE, kind) for kind in _SOLIDS),
    *((SPHERE, kind) for kind in (SPHERE, CAPSULE, CYLINDER, BOX)),
    *((CAPSULE, kind) for kind in (CAPSULE, BOX)),
}
DISTANCE_SENSORS = [
    int(getattr(mujoco.mjtSensor, f"mjSENS_GEOM{x}")) for x in ("DIST", "NORMAL", "FROMTO")
]


def geom_distances(
    model: Any,
    geom_xpos: Float[Array, "ngeom 3"],
    geom_xmat: Float[Array, "ngeom 3 3"],
    pairs: np.ndarray,
    distmax: Float[Array, "n"],
) -> tuple[Float[Array, "n"], Float[Array, "n 6"]]:
    """Signed distances of pairs of geoms, and their nearest points.

    Args:
      model: the model, with types, sizes and hulls of the geoms.
      geom_xpos: positions of the geoms (m).
      geom_xmat: orientations of the geoms.
      pairs: (n, 2) geoms, static.
      distmax: larger distances are replaced by this, and their nearest points by zeros (m).
    """
    shapes = Shape(geom_xpos, geom_xmat, jnp.asarray(model.geom_size, geom_xpos.dtype))
    types = model.geom_type[pairs]
    flipped = types[:, 0] > types[:, 1]
    rows = np.where(flipped[:, None], pairs[:, ::-1], pairs)
    keys = np.sort(types, axis=1)
    dist = jnp.asarray(distmax, geom_xpos.dtype)
    segment = jnp.zeros((len(pairs), 6), geom_xpos.dtype)
    for key in np.unique(keys, axis=0).tolist():
        (at,) = np.nonzero((keys == key).all(axis=1))
        function = _function(*key)
        if function is None:
            continue
        kind = ContactKind(1, (True, True))
        first, second = rows[at].T
        group = PairGroup((key[0], key[1]), kind, first, second, np.full(len(at), -1))
        contacts = pair_contacts(model, function, group, shapes, (first, second, group.pair))
        found, ends = jax.vmap(_nearest)(contacts)
        ends = jnp.where(jnp.asarray(flipped[at])[:, None], jnp.roll(ends, 3, axis=1), ends)
        near = found < take(dist, at)
        dist = dist.at[at].set(jnp.where(near, found, take(dist, at)))
        segment = segment.at[at].set(jnp.where(near[:, None], ends, 0))
    return dist, segment


def _function(first: int, second: int) -> Callable[[Shape, Shape], Contacts] | None:
    """Pair function with the nearest points of two types; None if distances are not supported."""
    if (first, second) in _CLOSED:
        return PAIRS[first, second].function
    if first in _SOLIDS and second in _SOLIDS:
        return convex_pair(_SOLIDS[first], _SOLIDS[second], max_contacts=1)[0]
    return None


def _nearest(contacts: Contacts) -> tuple[Float[Array, ""], Float[Array, "6"]]:
    """The smallest distance, and the nearest points."""
    index = jnp.argmin(contacts.dist)
    dist, pos = contacts.dist[index], contacts.pos[index]
    normal = jnp.broadcast_to(contacts.normal, contacts.pos.shape)[index]
    return dist, jnp.concatenate([pos - normal * dist / 2, pos + normal * dist / 2])


def distance_problems(model: Any, pairs: np.ndarray) -> Iterator[int]:
    """Geoms of pairs whose distance is not supported."""
    kinds = model.geom_type[pairs]
    known = np.isin(kinds, (PLANE, *_SOLIDS)) & ((kinds != MESH) | has_hull(model)[pairs])
    # MuJoCo does not measure between planes and height fields either.
    known |= ((kinds == PLANE) | (kinds == HFIELD)).all(axis=1, keepdims=True)
    yield from np.unique(pairs[~known]).tolist()


def has_hull(model: Any) -> np.ndarray:
    """(ngeom,) whether each geom has a hull; MuJoCo makes none for meshes that cannot collide."""
    if isinstance(model, mujoco.MjModel):
        faces = np.append(model.mesh_polynum, 0)
        return (model.geom_type == MESH) & (faces[model.geom_dataid] > 0)
    return model.geom_hull >= 0


def measured_pairs(model: Any, s: int) -> np.ndarray:
    """(n, 2) pairs of geoms whose distances sensor s measures."""
    ends = (
        (model.sensor_objtype[s], model.sensor_objid[s]),
        (model.sensor_reftype[s], model.sensor_refid[s]),
    )
    body = int(mujoco.mjtObj.mjOBJ_BODY)
    sides = [np.flatnonzero(model.geom_bodyid == i) if kind == body else [i] for kind, i in ends]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2).astype(int)


def measured_geoms(model: Any) -> np.ndarray:
    """Geoms whose distances sensors measure."""
    sensors = np.flatnonzero(np.isin(model.sensor_type, DISTANCE_SENSORS))
    pairs = [measured_pairs(model, int(s)) for s in sensors]
    return np.unique(np.concatenate([np.zeros((0, 2), int), *pairs]))
