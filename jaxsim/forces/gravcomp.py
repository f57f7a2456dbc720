"""Gravity compensation: forces that cancel part of a body's weight."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import gravity, project_wrench
from jaxsim.model import Model

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def qfrc_gravcomp(model: Model, kin: Kinematics) -> Float[Array, "nv"]:
    """Generalised forces of `-gravcomp * mass * gravity` at the bodies' centres of mass.

    They are passive forces, or actuator forces at joints with `actgravcomp`. Disabling both springs
    and dampers disables all passive forces, and these, too.
    """
    off = model.opt.disabled(_SPRING) and model.opt.disabled(_DAMPER)
    if off or not model.nonzero_rows("body_gravcomp"):
        return jnp.zeros_like(model.dof_damping)
    weight = model.body_mass * model.body_gravcomp
    force = -weight[:, None] * gravity(model)[None]
    return project_wrench(
        model, kin, jnp.concatenate([jnp.zeros_like(force), force], axis=1), kin.xipos
    )
