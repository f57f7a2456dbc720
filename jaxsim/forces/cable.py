"""Elastic cables: chains of bodies that resist bending and twisting."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import project_wrench
from jaxsim.model import Model
from jaxsim.spatial.quaternion import quat_inv_rotate, quat_log, quat_mul, quat_normalize

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def qfrc_cable(
    model: Model, kin: Kinematics, qpos: Float[Array, "nq"]
) -> Float[Array, "nv"] | float:
    """Generalised forces of cables, as of MuJoCo's plugin `mujoco.elasticity.cable`.

    With the rotation vector w of a body in the axes of the body before, w0 at rest and the
    stiffness `body_cable`, k, the torque on the body is `-k (w - w0)` there, and the body before
    feels the opposite. Disabling both springs and dampers disables it.
    """
    bodies = model.cable_body
    off = model.opt.disabled(_SPRING) and model.opt.disabled(_DAMPER)
    if off or not len(bodies):
        return 0.0
    quat = jnp.stack([quat_normalize(qpos[k : k + 4]) for k in model.cable_qposadr])
    turn = jax.vmap(quat_mul)(take(model.body_quat, bodies), quat)
    bent = jax.vmap(quat_log)(turn) - model.cable_curvature.astype(qpos.dtype)
    torque = -take(model.body_cable, bodies) * bent
    here = jax.vmap(quat_inv_rotate)(turn, torque)
    on_body = jnp.einsum("nij,nj->ni", take(kin.xmat, bodies), here)
    reacts = np.flatnonzero(model.cable_reacts)
    before = jnp.einsum("nij,nj->ni", take(kin.xmat, bodies[reacts] - 1), take(torque, reacts))
    both, where = jnp.concatenate([on_body, -before]), np.append(bodies, bodies[reacts] - 1)
    wrench = jnp.concatenate([both, jnp.zeros_like(both)], axis=1)
    return project_wrench(model, kin, wrench, take(kin.xpos, where), where)
