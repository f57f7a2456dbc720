"""Drag of a surrounding medium on bodies, by MuJoCo's inertia-box model.

Each body is replaced by the box with its mass and inertia. Drag acts along each axis of the box
separately and depends on the velocity relative to the wind. MuJoCo documentation, chapter
Computation, section "Inertia-based model".
"""

import math

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import sum_by, take
from jaxsim.arrays.polynomial import magnitude
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import project_wrench
from jaxsim.dynamics.velocity import Velocities, body_twists
from jaxsim.model import Model, ModelError

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def qfrc_fluid(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv"]:
    """Generalised forces of drag on all bodies.

    Raises:
      ModelError: a geom uses the ellipsoid model, and a medium was added after loading.
    """
    if not has_fluid(model):
        return jnp.zeros_like(model.dof_damping)
    _check_ellipsoids(model)
    viscous, quadratic = _coefficients(model)

    def one(mat, v, b, c):
        f = -(b + c * magnitude(v)) * v
        return jnp.concatenate([mat @ f[:3], mat @ f[3:]])

    wrench = jax.vmap(one)(kin.ximat, _relative_twists(model, kin, vel), viscous, quadratic)
    return project_wrench(model, kin, wrench, kin.xipos)


def link_drag(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "njnt 6 6"]:
    """Derivative of drag with respect to velocity: K with `d wrench = -K d twist` for each link.

    K is symmetric and positive semidefinite, about the tree's reference point.
    """
    viscous, quadratic = _coefficients(model)
    slope = viscous + 2 * quadratic * magnitude(_relative_twists(model, kin, vel))
    (moving,) = (model.body_link >= 0).nonzero()
    link = model.body_link[moving]
    arm = take(kin.xipos, moving) - take(take(kin.origin, model.tree.root), link)

    def one(mat, arm, slope):
        # J maps a twist about the reference point to one about the centre of mass in box axes.
        moment = jnp.stack([jnp.cross(arm, mat[:, k]) for k in range(3)])
        angular = jnp.concatenate([mat.T, jnp.zeros((3, 3), mat.dtype)], axis=1)
        J = jnp.concatenate([angular, jnp.concatenate([moment, mat.T], axis=1)])
        return (J.T * slope[None]) @ J

    each = jax.vmap(one)(take(kin.ximat, moving), arm, take(slope, moving))
    return sum_by(each, link, model.njnt)


def has_fluid(model: Model) -> bool:
    """Whether the model may have drag; disabling springs and dampers disables it, too."""
    off = model.opt.disabled(_SPRING) and model.opt.disabled(_DAMPER)
    medium = model.nonzero_rows("opt.density") or model.nonzero_rows("opt.viscosity")
    return bool(medium) and not off


def _check_ellipsoids(model: Model) -> None:
    for geom in np.flatnonzero(model.structure.source.geom_fluid[:, 0]):
        raise ModelError(
            f"{model.names.label('geom', int(geom))}: fluidshape is not supported in a medium; "
            "load the model without it for the inertia-box fluid model"
        )


def _relative_twists(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nbody 6"]:
    """Twists of bodies relative to the wind, about the centres of mass and in the box axes."""

    def one(mat, twist):
        return jnp.concatenate([twist[:3] @ mat, (twist[3:] - model.opt.wind) @ mat])

    return jax.vmap(one)(kin.ximat, body_twists(model, kin, vel.cvel, kin.xipos))


def _coefficients(model: Model) -> tuple[Float[Array, "nbody 6"], Float[Array, "nbody 6"]]:
    """Coefficients b and c of the drag `-(b + c |v|) v`, for each body and component of twist."""
    viscosity, density = model.opt.viscosity, model.opt.density

    def one(mass, inertia):
        light = mass < MINVAL
        squares = jnp.sum(inertia) - 2 * inertia
        box = jnp.sqrt(jnp.maximum(squares, MINVAL) / jnp.where(light, 1.0, mass) * 6)
        diameter = jnp.sum(box) / 3
        b = jnp.stack([math.pi * diameter**3] * 3 + [3 * math.pi * diameter] * 3) * viscosity
        x, y, z = box
        turning = jnp.stack([x * (y**4 + z**4), y * (x**4 + z**4), z * (x**4 + y**4)]) / 64
        c = jnp.concatenate([turning, jnp.stack([y * z, x * z, x * y]) / 2]) * density
        return jnp.where(light, 0.0, b), jnp.where(light, 0.0, c)

    return jax.vmap(one)(model.body_mass, model.body_inertia)
