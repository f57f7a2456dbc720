"""Passive forces: springs, dampers, gravity compensation, drag, adhesion and cables."""

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.collision import Contact
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.velocity import Velocities
from jaxsim.forces.adhesion import qfrc_adhesion
from jaxsim.forces.cable import qfrc_cable
from jaxsim.forces.damper import qfrc_damper
from jaxsim.forces.gravcomp import qfrc_gravcomp
from jaxsim.forces.medium.fluid import qfrc_fluid
from jaxsim.forces.spring import qfrc_spring
from jaxsim.model import Model


@struct.dataclass
class PassiveForces:
    """Generalised forces (N, N m) with MuJoCo's names.

    Attributes:
      qfrc_spring: springs of joints and tendons.
      qfrc_damper: dampers of joints, tendons and actuators.
      qfrc_gravcomp: all gravity compensation, including that exerted by actuators.
      qfrc_fluid: drag.
      qfrc_adhesion: pull of surfaces that adhere.
      qfrc_passive: their sum and the forces of cables, without gravity compensation that actuators
        exert.
    """

    qfrc_spring: Float[Array, "nv"]
    qfrc_damper: Float[Array, "nv"]
    qfrc_gravcomp: Float[Array, "nv"]
    qfrc_fluid: Float[Array, "nv"]
    qfrc_adhesion: Float[Array, "nv"]
    qfrc_passive: Float[Array, "nv"]


def passive_forces(
    model: Model,
    kin: Kinematics,
    vel: Velocities,
    qpos: Float[Array, "nq"],
    qvel: Float[Array, "nv"],
    contact: Contact | None = None,
) -> PassiveForces:
    """All passive forces at one instant.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its link velocities.
      qpos: coordinates.
      qvel: velocities.
      contact: the contacts, for adhesion; None for none.
    """
    spring, damper = qfrc_spring(model, kin, qpos), qfrc_damper(model, kin, qvel)
    gravcomp, fluid = qfrc_gravcomp(model, kin), qfrc_fluid(model, kin, vel)
    adhesion, cable = qfrc_adhesion(model, kin, contact), qfrc_cable(model, kin, qpos)
    passive = ~np.asarray(model.jnt_actgravcomp, bool)[model.dof_jntid]
    return PassiveForces(
        qfrc_spring=spring,
        qfrc_damper=damper,
        qfrc_gravcomp=gravcomp,
        qfrc_fluid=fluid,
        qfrc_adhesion=adhesion,
        qfrc_passive=spring + damper + fluid + adhesion + cable + jnp.where(passive, gravcomp, 0),
    )
