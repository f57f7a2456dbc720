"""What happens at one instant: from a state and controls to forces and accelerations.

kinematics -> inertia and bias -> forces -> contacts -> convex problem -> acceleration
"""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.collision import Contact, detect, model_candidates
from jaxsim.constraint import Constrained, Scene, constrained_acceleration
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.rnea import (
    generalized_force,
    link_accelerations,
    link_forces,
    wrench_on_links,
)
from jaxsim.dynamics.velocity import Velocities, velocities
from jaxsim.engine.integrate import Instant
from jaxsim.forces.actuation import Actuation, actuation
from jaxsim.forces.passive import PassiveForces, passive_forces
from jaxsim.model import Model, State


@struct.dataclass
class Smooth:
    """Everything at an instant that does not depend on constraints.

    Attributes:
      kin: kinematics.
      vel: link velocities.
      passive: springs, dampers, gravity compensation, drag.
      actuation: what the actuators do.
      inertial_force: what each link's motion without `qacc` needs, gravity included; tree order.
      qfrc_smooth: all generalised forces but those of constraints, minus the bias.
    """

    kin: Kinematics
    vel: Velocities
    passive: PassiveForces
    actuation: Actuation
    inertial_force: Float[Array, "njnt 6"]
    qfrc_smooth: Float[Array, "nv"]


@struct.dataclass
class Evaluation:
    """Everything at an instant."""

    smooth: Smooth
    contact: Contact
    constrained: Constrained

    def instant(self) -> Instant:
        """The part that an integrator needs."""
        s = self.smooth
        force = s.qfrc_smooth + self.constrained.qfrc_constraint
        return Instant(s.kin, s.vel, s.actuation, force, self.constrained.qacc)


def evaluate(model: Model, state: State, ctrl: Float[Array, "nu"] | None) -> Evaluation:
    """Forces, contacts and accelerations of a state."""
    smooth = smooth_dynamics(model, state, ctrl)
    scene, contact = constraint_scene(model, state, smooth.kin, smooth.vel)
    constrained = constrained_acceleration(scene, contact, smooth.qfrc_smooth, state.qacc_warmstart)
    return Evaluation(smooth, contact, constrained)


def smooth_dynamics(model: Model, state: State, ctrl: Float[Array, "nu"] | None) -> Smooth:
    """Kinematics and all forces but those of constraints."""
    kin = kinematics(model, state.qpos, state.mocap_pos, state.mocap_quat)
    vel = velocities(model, kin, state.qvel)
    inertial = link_forces(model, kin, vel, link_accelerations(model, kin, vel))
    passive = passive_forces(model, kin, vel, state.qpos, state.qvel)
    actuators = actuation(
        model, kin, state.qpos, state.qvel, state.act, ctrl, passive.qfrc_gravcomp
    )
    # One sum over the tree serves both what is applied to the bodies and what they need.
    on_links = generalized_force(model, kin, applied_wrench(model, kin, state) - inertial)
    total = passive.qfrc_passive + actuators.qfrc_actuator + state.qfrc_applied + on_links
    return Smooth(kin, vel, passive, actuators, inertial, total)


def applied_wrench(model: Model, kin: Kinematics, state: State) -> Float[Array, "njnt 6"]:
    """What the user applies to the bodies, as wrenches on the links."""
    wrench = jnp.concatenate([state.xfrc_applied[:, 3:], state.xfrc_applied[:, :3]], axis=1)
    return wrench_on_links(model, kin, wrench, kin.xipos)


def constraint_scene(
    model: Model, state: State, kin: Kinematics, vel: Velocities
) -> tuple[Scene, Contact]:
    """What the constraint rows are computed from."""
    contact = detect(model, model_candidates(model), kin.geom_xpos, kin.geom_xmat)
    return Scene(model, kin, vel, state.qpos, state.qvel), contact
