"""Forces of a surrounding medium on bodies, by MuJoCo's two models.

A geom with `fluidshape="ellipsoid"` is an ellipsoid in the medium. A body without such geoms is a
box. The forces depend on the velocity relative to the wind.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import sum_by, take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import project_wrench
from jaxsim.dynamics.velocity import Velocities, body_twists
from jaxsim.forces.medium.ellipsoid_fluid import EllipsoidDrag, ellipsoid_drag
from jaxsim.forces.medium.inertia_box import BoxDrag, box_drag
from jaxsim.model import Model

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


class _Shapes(NamedTuple):
    """Shapes of one model in the medium: their bodies, positions, axes and laws, stacked."""

    body: np.ndarray
    pos: Float[Array, "n 3"]
    mat: Float[Array, "n 3 3"]
    law: BoxDrag | EllipsoidDrag


def qfrc_fluid(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv"]:
    """Generalised forces of the medium on all bodies."""
    total = jnp.zeros_like(model.dof_damping)
    if not has_fluid(model):
        return total

    def world(law, mat, twist):
        wrench = law.wrench(twist)
        return jnp.concatenate([mat @ wrench[:3], mat @ wrench[3:]])

    for shapes in _shapes(model, kin):
        twist = _relative_twists(model, kin, vel, shapes)
        wrench = jax.vmap(world)(shapes.law, shapes.mat, twist)
        total = total + project_wrench(model, kin, wrench, shapes.pos, shapes.body)
    return total


def link_drag(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "njnt 6 6"]:
    """Derivative of the forces with respect to velocity: K with `d wrench = -K d twist`.

    K of each link is about the tree's reference point. It is symmetric and positive semidefinite
    for boxes; ellipsoids have lift, too.
    """

    def one(law, mat, arm, twist):
        # J maps a twist about the reference point to one about the shape's centre in its axes.
        moment = jnp.stack([jnp.cross(arm, mat[:, k]) for k in range(3)])
        angular = jnp.concatenate([mat.T, jnp.zeros((3, 3), mat.dtype)], axis=1)
        J = jnp.concatenate([angular, jnp.concatenate([moment, mat.T], axis=1)])
        return J.T @ law.slope(twist) @ J

    total = jnp.zeros((model.njnt, 6, 6), kin.xpos.dtype)
    for shapes in _shapes(model, kin):
        link = model.body_link[shapes.body]
        arm = shapes.pos - take(take(kin.origin, model.tree.root), link)
        twist = _relative_twists(model, kin, vel, shapes)
        each = jax.vmap(one)(shapes.law, shapes.mat, arm, twist)
        total = total + sum_by(each, link, model.njnt)
    return total


def has_fluid(model: Model) -> bool:
    """Whether the model may be in a medium; disabling springs and dampers disables it, too."""
    off = model.opt.disabled(_SPRING) and model.opt.disabled(_DAMPER)
    medium = model.nonzero_rows("opt.density") or model.nonzero_rows("opt.viscosity")
    return bool(medium) and not off


def _shapes(model: Model, kin: Kinematics) -> Iterator[_Shapes]:
    """Boxes and ellipsoids of the bodies that joints move."""
    (geoms,) = np.nonzero(model.geom_ellipsoid & (model.body_link[model.geom_bodyid] >= 0))
    owners = model.geom_bodyid[geoms]
    boxes = np.setdiff1d(np.flatnonzero(model.body_link >= 0), owners)
    if len(boxes):
        law = jax.tree.map(lambda a: take(a, boxes), box_drag(model))
        yield _Shapes(boxes, take(kin.xipos, boxes), take(kin.ximat, boxes), law)
    if len(geoms):
        law = ellipsoid_drag(model, geoms)
        # As in MuJoCo, bodies without mass feel nothing.
        heavy = (take(model.body_mass, owners) >= MINVAL)[:, None]
        law = law.replace(fluid=jnp.where(heavy, law.fluid, 0))
        yield _Shapes(owners, take(kin.geom_xpos, geoms), take(kin.geom_xmat, geoms), law)


def _relative_twists(
    model: Model, kin: Kinematics, vel: Velocities, shapes: _Shapes
) -> Float[Array, "n 6"]:
    """Twists of shapes relative to the wind, about their positions and in their axes."""

    def one(mat, twist):
        return jnp.concatenate([twist[:3] @ mat, (twist[3:] - model.opt.wind) @ mat])

    return jax.vmap(one)(shapes.mat, body_twists(model, kin, vel.cvel, shapes.pos, shapes.body))
