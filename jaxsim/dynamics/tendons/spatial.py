"""Spatial tendons: lengths of shortest paths through sites and over surfaces, and their Jacobian.

A tendon is a frictionless cord under tension. The rate of its length is a sum over its straight
parts, of the direction times the difference of the velocities of both ends, which are points on
bodies. Sliding of these points along a surface does not count, because the path is the shortest.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.dynamics.tendons.path import CYLINDER, SPHERE, Segments, segments, spatial_tendons
from jaxsim.dynamics.tendons.wrapping import wrap_cylinder, wrap_sphere
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order

if TYPE_CHECKING:
    from jaxsim.dynamics.kinematics import Kinematics

_WRAPS = {SPHERE: wrap_sphere, CYLINDER: wrap_cylinder}


class Pull(NamedTuple):
    """Lengths of segments and the forces of a unit tension, positive if it lengthens the tendon.

    Attributes:
      length: length of the segment (m).
      first: unit vector; the force on the first site is `-first`.
      last: unit vector; the force on the last site is `last`.
      start: point where the tendon meets the surface (m); the force on the surface is `first`.
      stop: point where it leaves the surface (m); the force on the surface is `-last`.
    """

    length: Float[Array, ""]
    first: Float[Array, "3"]
    last: Float[Array, "3"]
    start: Float[Array, "3"]
    stop: Float[Array, "3"]


def spatial_paths(
    model: Model, kin: "Kinematics"
) -> tuple[Float[Array, "ntendon"], Float[Array, "nspatial nv"]]:
    """Lengths of all tendons (zero for fixed ones) and the Jacobian of the spatial tendons.

    Args:
      model: the model.
      kin: its kinematics; only poses and motion axes are read.
    """
    lengths, wrenches, pairs = unit_wrenches(model, kin)
    return lengths, _rows(model, kin, wrenches, pairs)


def unit_wrenches(
    model: Model, kin: "Kinematics"
) -> tuple[Float[Array, "ntendon"], Float[Array, "m 6"], np.ndarray]:
    """Lengths of all tendons, and wrenches on links of unit forces that lengthen spatial tendons.

    Args:
      model: the model.
      kin: its kinematics.

    Returns:
      The lengths (zero for fixed tendons), the wrenches about the reference points of the links'
      trees, and the (m, 2) tendon and link of each; link -1 never moves.
    """
    kinds, dtype = segments(model), kin.cdof.dtype
    lengths, wrenches = [jnp.zeros(0, dtype)], [jnp.zeros((0, 6), dtype)]
    tendons, pairs = [np.zeros(0, int)], [np.zeros((0, 2), int)]
    for group in kinds:
        pull = _pulls(model, kin, group)
        share = _share(model, group)
        lengths.append(share * pull.length)
        tendons.append(group.tendon)
        for body, wrench in _wrenches(model, kin, group, pull):
            wrenches.append(share[:, None] * wrench)
            pairs.append(np.stack([group.tendon, model.body_link[body]], axis=1))
    total = sum_by(jnp.concatenate(lengths), np.concatenate(tendons), model.ntendon)
    return total, jnp.concatenate(wrenches), np.concatenate(pairs)


def _pulls(model: Model, kin: "Kinematics", group: Segments) -> Pull:
    """Lengths and forces of segments of one kind."""
    ends = take(kin.site_xpos, group.first), take(kin.site_xpos, group.last)
    wrap = _WRAPS.get(group.surface)
    if wrap is None:
        return jax.vmap(_straight)(*ends)
    geoms = (take(x, group.geom) for x in (kin.geom_xpos, kin.geom_xmat, model.geom_size[:, 0]))
    sided = (group.side >= 0).all()
    sides = (take(kin.site_xpos, group.side),) if sided else ()
    return jax.vmap(lambda x0, x1, *surface: _over(wrap, x0, x1, *surface))(*ends, *geoms, *sides)


def _straight(x0, x1) -> Pull:
    length, divisor = norm_and_divisor(x1 - x0)
    direction = (x1 - x0) / divisor
    return Pull(length, direction, direction, x0, x0)


def _over(wrap, x0, x1, *surface) -> Pull:
    """A segment over a surface. If it misses it, both forces act at one point there and cancel."""
    w, direct = wrap(x0, x1, *surface), _straight(x0, x1)
    before, after = _straight(x0, w.start), _straight(w.stop, x1)
    length = before.length + w.length + after.length
    wrapped = Pull(length, before.first, after.last, w.start, w.stop)
    return Pull(*(jnp.where(w.touches, a, b) for a, b in zip(wrapped, direct, strict=True)))


def _share(model: Model, group: Segments) -> Float[Array, "n"]:
    """Factor of each segment's length: one over the divisor of its pulley."""
    if (group.pulley < 0).all():
        return jnp.ones(len(group.pulley), model.wrap_prm.dtype)
    divisor = jnp.append(model.wrap_prm, 1.0)
    return 1 / take(divisor, np.where(group.pulley < 0, len(divisor) - 1, group.pulley))


def _wrenches(model: Model, kin: "Kinematics", group: Segments, pull: Pull):
    """Yield bodies and the wrenches on them, about the reference points of their trees."""
    first, last = model.site_bodyid[group.first], model.site_bodyid[group.last]
    points = take(kin.site_xpos, group.first), take(kin.site_xpos, group.last)
    yield first, -_about(model, kin, first, points[0], pull.first)
    yield last, _about(model, kin, last, points[1], pull.last)
    if group.surface in _WRAPS:
        body = model.geom_bodyid[group.geom]
        come = _about(model, kin, body, pull.start, pull.first)
        yield body, come - _about(model, kin, body, pull.stop, pull.last)


def _about(model: Model, kin: "Kinematics", body: np.ndarray, point, force):
    """(n, 6) wrenches of forces at points on bodies; arbitrary for bodies that never move."""
    link = model.body_link[body]
    if not len(model.tree):
        return jnp.concatenate([force, force], axis=1)
    arm = point - take(take(kin.origin, model.tree.root), np.maximum(link, 0))
    return jnp.concatenate([jax.vmap(jnp.cross)(arm, force), force], axis=1)


def _rows(model: Model, kin: "Kinematics", wrench, pairs: np.ndarray):
    """The Jacobian, from wrenches on links; `pairs` are the (tendon, link) of each wrench."""
    spatial = spatial_tendons(model)
    moving = pairs[:, 1] >= 0
    unique, group = np.unique(pairs[moving], axis=0, return_inverse=True)
    total = sum_by(take(wrench, np.nonzero(moving)[0]), group.ravel(), len(unique))
    # A wrench does work on the degrees of freedom that move its link.
    moves = jnp.asarray(model.tree.moves[unique[:, 1]])
    each = jnp.where(moves, total @ kin.cdof.T, 0)
    rows = sum_by(each, np.searchsorted(spatial, unique[:, 0]), len(spatial))
    return from_tree_order(model, rows.T).T
