"""`missing_force`: the inverse of a step of semi-implicit Euler, which needs no solve."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.constraint import constrained_at
from jaxsim.constraint.laws import ON_VELOCITIES, Blur
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.motion import motion_of
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import generalized_force, link_accelerations, link_forces
from jaxsim.engine.integrators.euler import damps_implicitly
from jaxsim.engine.stepping import applied_wrench, contacts, forces
from jaxsim.forces.damper import dof_damping_slope
from jaxsim.model import Model, State


def missing_force(
    model: Model,
    state: State,
    ctrl: Float[Array, "nu"],
    qvel: Float[Array, "nv"],
    blur: Blur | None = None,
) -> Float[Array, "nv"]:
    """The generalised force without which `step` does not reach the velocity `qvel`.

        (M + h D) a + bias - passive - actuator - applied - J^T f,    a = (qvel - state.qvel) / h

    with the damping D of joints. It is zero if and only if `step(model, state, ctrl).qvel` is
    `qvel`, with the model's own law of contact for the constraint forces f.

    Args:
      model: the model; its integrator is Euler's, and its contacts are not rigid.
      state: the state before the step.
      ctrl: controls.
      qvel: velocity after the step.
      blur: how much the law of contact is smoothed; None for the law itself.
    """
    motion = motion_of(model, state)
    touching = contacts(motion)
    kin, h = motion.kin, model.opt.timestep
    passive, actuators = forces(motion, state, ctrl, touching)
    a = (qvel - state.qvel) / h
    damping = _implicit_damping(model, state) * a
    qacc = a if model.contact in ON_VELOCITIES else a + solve_mass(model, kin, damping)
    link = link_forces(model, kin, motion.vel, link_accelerations(model, kin, motion.vel, a))
    needed = generalized_force(model, kin, link - applied_wrench(motion, state))
    needed = needed + dof_armature(model) * a + damping - state.qfrc_applied
    pushed = passive.qfrc_passive + actuators.qfrc_actuator
    return needed - pushed - constrained_at(motion, touching, qacc, blur).qfrc_constraint


def _implicit_damping(model: Model, state: State) -> Float[Array, "nv"]:
    """`h D`, zero where the damping of joints is explicit."""
    if not damps_implicitly(model):
        return jnp.zeros_like(state.qvel)
    return model.opt.timestep * dof_damping_slope(model, state.qvel)
