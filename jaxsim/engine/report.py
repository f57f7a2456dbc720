"""`forward` and `inverse`: all quantities at one instant, with MuJoCo's names."""

import jax.numpy as jnp
import mujoco
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.precision import full_precision
from jaxsim.arrays.whole import as_a_whole
from jaxsim.constraint import Constrained, constrained_at
from jaxsim.constraint.laws import ON_VELOCITIES
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.motion import motion_of
from jaxsim.dynamics.rnea import inertial_force, qfrc_bias
from jaxsim.engine.continuous import instant_acceleration
from jaxsim.engine.delays import reported_readings
from jaxsim.engine.instant import Instant
from jaxsim.engine.readout import energies, read_sensors
from jaxsim.engine.status import Status
from jaxsim.engine.stepping import contacts, evaluate, forces
from jaxsim.model import Model, State
from jaxsim.model.inputs import admit, admit_array

_INVDISCRETE = mujoco.mjtEnableBit.mjENBL_INVDISCRETE


@struct.dataclass
class ContactReport:
    """The contact slots of an environment; a slot holds a contact with force only if `active`.

    Attributes:
      dist: distance between the surfaces, negative for penetration (m).
      pos: midpoint between the surfaces (m).
      frame: rows are the normal, from geom1 to geom2, and two tangents.
      geom1: first geom.
      geom2: second geom.
      force: (force, torque) on geom2 in the contact frame, normal first, as `mj_contactForce`.
      active: whether the contact is closer than its margin.
    """

    dist: Float[Array, "nc"]
    pos: Float[Array, "nc 3"]
    frame: Float[Array, "nc 3 3"]
    geom1: Int[Array, "nc"]
    geom2: Int[Array, "nc"]
    force: Float[Array, "nc 6"]
    active: Bool[Array, "nc"]


@struct.dataclass
class Forward:
    """All quantities at one instant; names, shapes and order are MuJoCo's.

    `cost` is the objective of the constraint problem at its solution, and `status` is the status of
    its solve.
    """

    xpos: Float[Array, "nbody 3"]
    xquat: Float[Array, "nbody 4"]
    xmat: Float[Array, "nbody 3 3"]
    xipos: Float[Array, "nbody 3"]
    geom_xpos: Float[Array, "ngeom 3"]
    geom_xmat: Float[Array, "ngeom 3 3"]
    site_xpos: Float[Array, "nsite 3"]
    site_xmat: Float[Array, "nsite 3 3"]
    subtree_com: Float[Array, "nbody 3"]
    mass_matrix: Float[Array, "nv nv"]
    qfrc_bias: Float[Array, "nv"]
    qfrc_passive: Float[Array, "nv"]
    qfrc_actuator: Float[Array, "nv"]
    qfrc_smooth: Float[Array, "nv"]
    qfrc_constraint: Float[Array, "nv"]
    actuator_length: Float[Array, "nout"]
    actuator_velocity: Float[Array, "nout"]
    actuator_force: Float[Array, "nout"]
    act_dot: Float[Array, "na"]
    qacc_smooth: Float[Array, "nv"]
    qacc: Float[Array, "nv"]
    sensordata: Float[Array, "nsensordata"]
    energy: Float[Array, "2"]
    cost: Float[Array, ""]
    contact: ContactReport
    status: Status


@full_precision
def forward(model: Model, state: State, ctrl: Float[Array, "nu"] | None = None) -> Forward:
    """All quantities of a state without integrating it, as MuJoCo's `mj_forward`.

    `jaxsim.forward_details` has more: `cvel`, `cdof`, `cinert`, `efc_J` and the like.

    Args:
      model: the model.
      state: the state.
      ctrl: controls; None means zeros.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    return _forward(*admit(model, state, ctrl))


@as_a_whole
def _forward(model: Model, state: State, ctrl: Float[Array, "nu"] | None) -> Forward:
    return report(evaluate(model, state, ctrl), state)


def report(now: Instant, state: State) -> Forward:
    """The public record of an instant."""
    model, kin, found = now.motion.model, now.motion.kin, now.constrained
    energy = energies(now, state)
    qacc_smooth = solve_mass(model, kin, now.qfrc_smooth)
    return Forward(
        xpos=kin.xpos,
        xquat=kin.xquat,
        xmat=kin.xmat,
        xipos=kin.xipos,
        geom_xpos=kin.geom_xpos,
        geom_xmat=kin.geom_xmat,
        site_xpos=kin.site_xpos,
        site_xmat=kin.site_xmat,
        subtree_com=kin.subtree_com,
        mass_matrix=composite_mass_matrix(model, kin),
        qfrc_bias=qfrc_bias(model, kin, now.motion.vel),
        qfrc_passive=now.passive.qfrc_passive,
        qfrc_actuator=now.actuation.qfrc_actuator,
        qfrc_smooth=now.qfrc_smooth,
        qfrc_constraint=found.qfrc_constraint,
        actuator_length=now.actuation.actuator_length,
        actuator_velocity=now.actuation.actuator_velocity,
        actuator_force=now.actuation.actuator_force,
        act_dot=now.actuation.act_dot,
        qacc_smooth=qacc_smooth,
        qacc=found.qacc,
        sensordata=reported_readings(model, state, read_sensors(now, state, energy)),
        energy=energy,
        # The solver's objective lacks the constant part of `1/2 |qacc - qacc_smooth|_M^2`.
        cost=found.status.cost + 0.5 * now.qfrc_smooth @ qacc_smooth,
        contact=_contact_report(found),
        status=Status.of(found),
    )


@full_precision
def inverse(
    model: Model,
    state: State,
    qacc: Float[Array, "nv"],
    ctrl: Float[Array, "nu"] | None = None,
) -> Float[Array, "nv"]:
    """Forces that produce an acceleration, with constraints, as MuJoCo's `mj_inverse`.

    They are `M qacc + qfrc_bias - qfrc_passive - J^T f(qacc)`, where the constraint forces f need
    no solve, as the acceleration is known. For the acceleration of `forward`, they equal the
    applied and actuator forces. With the flag `invdiscrete` they do so for the acceleration of a
    time step, the change of the velocity divided by the timestep.

    Args:
      model: the model.
      state: the state.
      qacc: acceleration.
      ctrl: controls; None means zeros. Results depend on them only with `invdiscrete` and an
        implicit integrator, by the slopes of actuator forces.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
      ModelError: the model has `invdiscrete` and integrator RK4.
    """
    model, state, ctrl = admit(model, state, ctrl)
    qacc = admit_array(model, qacc, (model.nv,), "qacc")
    motion = motion_of(model, state)
    kin, vel = motion.kin, motion.vel
    touching = contacts(motion)
    passive, actuators = forces(motion, state, ctrl, touching)
    # Laws on velocities are functions of the acceleration of the step.
    on_step = qacc
    if model.opt.enabled(_INVDISCRETE):
        qacc = instant_acceleration(motion, actuators, qacc)
    found = constrained_at(motion, touching, on_step if model.contact in ON_VELOCITIES else qacc)
    needed = inertial_force(model, kin, vel, qacc)
    return needed - passive.qfrc_passive - found.qfrc_constraint


def _contact_report(found: Constrained) -> ContactReport:
    contact = found.contact
    return ContactReport(
        dist=contact.dist,
        pos=contact.pos,
        frame=contact.frame,
        geom1=jnp.asarray(contact.geom1),
        geom2=jnp.asarray(contact.geom2),
        force=found.contact_force,
        active=contact.active,
    )
