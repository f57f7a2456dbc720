"""Inertia of tendons: armature m adds `m (J qvel)^2 / 2` to the kinetic energy.

It adds `m J^T J` to the mass matrix and `m J^T dJ/dt qvel` to the bias. As in MuJoCo, entries of
the mass matrix for degrees of freedom on different branches of the tree are left out.
"""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import tendon_armature
from jaxsim.dynamics.tendons.path import spatial_tendons
from jaxsim.dynamics.tendons.spatial import unit_wrenches
from jaxsim.dynamics.tendons.tendon import tendon_force_on_joints, tendon_jacobian
from jaxsim.dynamics.velocity import Velocities, body_twists
from jaxsim.model import Model

_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)


def has_tendon_inertia(model: Model) -> bool:
    """Whether a tendon, or an actuator of one, may have armature."""
    motors = [model.actuator_trntype[i] == _TENDON for i in model.nonzero_rows("actuator_armature")]
    return bool(model.nonzero_rows("tendon_armature")) or any(motors)


def tendon_inertia(model: Model, kin: Kinematics) -> Float[Array, "nv nv"]:
    """What tendons add to the mass matrix, `J^T diag(m) J` without entries across branches."""
    J = tendon_jacobian(model, kin)
    return jnp.where(model.structure.related_dofs, (J.T * tendon_armature(model)[None]) @ J, 0)


def tendon_bias(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv"]:
    """What tendons add to the bias forces, `J^T diag(m) dJ/dt qvel`."""
    tension = tendon_armature(model) * _accelerations(model, kin, vel)
    return tendon_force_on_joints(model, kin, tension)


def _accelerations(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "ntendon"]:
    """`dJ/dt qvel`: second derivatives of the lengths for zero `qacc`; zero for fixed tendons.

    The rate of a length is a sum over links of their twists times the wrenches of a unit tension,
    `sum w . v`; its derivative is `sum dw/dt . v + w . dv/dt`.
    """
    if not len(spatial_tendons(model)):
        return jnp.zeros_like(kin.ten_length)
    sites = body_twists(model, kin, vel.cvel, kin.site_xpos, model.site_bodyid)
    geoms = body_twists(model, kin, vel.cvel, kin.geom_xpos, model.geom_bodyid)
    turning = jax.vmap(lambda omega, R: jnp.cross(omega[None], R.T).T)(geoms[:, :3], kin.geom_xmat)
    _, _, pairs = unit_wrenches(model, kin)

    def wrenches(site_xpos, geom_xpos, geom_xmat):
        moved = kin.replace(site_xpos=site_xpos, geom_xpos=geom_xpos, geom_xmat=geom_xmat)
        return unit_wrenches(model, moved)[1]

    at = kin.site_xpos, kin.geom_xpos, kin.geom_xmat
    wrench, rate = jax.jvp(wrenches, at, (sites[:, 3:], geoms[:, 3:], turning))
    (moving,) = (pairs[:, 1] >= 0).nonzero()
    tendon, link = pairs[moving].T
    each = take(rate, moving) * take(vel.cvel, link) + take(wrench, moving) * take(vel.bias, link)
    return sum_by(each.sum(axis=1), tendon, model.ntendon)
