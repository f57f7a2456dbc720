"""Shapes that pairs are tested with, sizes as in MJCF, and both geoms of a pair as arrays."""

import functools
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.collision import PAIRS, Shape
from jaxsim.collision.hulls import Hulls
from jaxsim.collision.table import type_name
from jaxsim.io.hulls import hull_tables

SIZES = {
    "plane": "1 1 1",
    "sphere": "0.11",
    "capsule": "0.07 0.15",
    "ellipsoid": "0.08 0.12 0.17",
    "cylinder": "0.09 0.12",
    "box": "0.08 0.11 0.14",
}
# A wedge with a ridge: faces of three and of four corners.
WEDGE = "-.1 -.12 -.05  .1 -.12 -.05  .1 .12 -.05  -.1 .12 -.05  0 .1 .1  0.02 -.1 .1"

# Height fields and signed distance functions have tests of their own.
ALL = [
    (type_name(a), type_name(b))
    for a, b in PAIRS
    if type_name(a) != "hfield" and type_name(b) != "sdf"
]


def entry(names):
    """The line of the table for two types."""
    return PAIRS[next(k for k in PAIRS if tuple(map(type_name, k)) == names)]


# Pairs without a closed form.
GENERAL = [
    names for names in ALL if entry(names).function.__module__ == "jaxsim.collision.convex.contacts"
]


def geom(name, margin=0.0):
    """MJCF of a geom."""
    size = 'mesh="wedge"' if name == "mesh" else f'size="{SIZES[name]}"'
    return f'<geom type="{name}" {size} margin="{margin}"/>'


def hulls(model):
    """The hull of each geom, or None."""
    tables = SimpleNamespace(**hull_tables(model, lambda kind, index: f"{kind} {index}"))
    meshes = np.flatnonzero(tables.geom_hull >= 0)
    found = [None] * model.ngeom
    for geom in meshes:
        all_hulls = Hulls(tables, meshes, float)
        shape = Shape(np.zeros(3), np.eye(3), model.geom_size[geom])
        row = np.asarray(tables.geom_hull[geom], np.int32)
        found[geom] = jax.device_get(all_hulls.complete(shape, row).hull)
    return found


@functools.cache
def values(names):
    """Batched function of positions, rotations, sizes and hulls: distances, points, normals.

    A fifth argument is the distance up to which contacts are listed, by default zero.
    """
    function = entry(names).function

    def evaluate(pos, mat, size, hull, margin):
        first, second = (Shape(pos[i], mat[i], size[i], hull[i]) for i in range(2))
        c = function(first.replace(margin=margin), second)
        return c.dist, c.pos, jnp.broadcast_to(c.normal, c.pos.shape)

    batched = quick_jit(jaxsim.vmap(evaluate, in_axes=(0, 0, None, None, None)))
    return lambda pos, mat, size, hull, margin=0.0: batched(pos, mat, size, hull, margin)


def rounded(x, dtype):
    """Floating-point leaves in another type."""
    return jax.tree.map(lambda v: v.astype(dtype) if v.dtype.kind == "f" else v, x)
