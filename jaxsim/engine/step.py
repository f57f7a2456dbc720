"""`step`, `forward`, `inverse` and `rollout`: pure functions of one environment."""

import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.arrays.precision import full_precision
from jaxsim.collision import Contact
from jaxsim.constraint import constrained_at
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import generalized_force, link_accelerations, link_forces
from jaxsim.engine.integrate import Step, integrate_step
from jaxsim.engine.pipeline import Evaluation, constraint_scene, evaluate, smooth_dynamics
from jaxsim.engine.readout import read_sensors
from jaxsim.model import Model, State
from jaxsim.quantities.energy import kinetic_energy, potential_energy


@struct.dataclass
class ContactReport:
    """The contact slots of an environment; those with `dist` beyond the margin are not in contact.

    Attributes:
      dist: distance between the surfaces, negative in penetration (m).
      pos: midpoint between the surfaces (m).
      frame: rows are the normal, from geom1 to geom2, and two tangents.
      geom1: first geom.
      geom2: second geom.
      force: (force, torque) on geom2 in the contact frame, normal first: `mj_contactForce`.
      active: whether the slot generates constraint rows.
    """

    dist: Float[Array, "nc"]
    pos: Float[Array, "nc 3"]
    frame: Float[Array, "nc 3 3"]
    geom1: Int[Array, "nc"]
    geom2: Int[Array, "nc"]
    force: Float[Array, "nc 6"]
    active: Bool[Array, "nc"]


@struct.dataclass
class Status:
    """Trouble as data; `jaxsim.check` turns it into a message.

    Attributes:
      iterations: Newton steps taken.
      residual: norm of the objective's gradient at the solution; gradients are wrong where it is
        not small.
      cost: value of the objective.
      finite: False if the solver met numbers that are not finite.
      contact_overflow: contacts that found no slot.
    """

    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    cost: Float[Array, ""]
    finite: Bool[Array, ""]
    contact_overflow: Int[Array, ""]


@struct.dataclass
class Forward:
    """Everything at one instant; names, shapes and order are MuJoCo's."""

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
    actuator_length: Float[Array, "nu"]
    actuator_velocity: Float[Array, "nu"]
    actuator_force: Float[Array, "nu"]
    act_dot: Float[Array, "na"]
    qacc_smooth: Float[Array, "nv"]
    qacc: Float[Array, "nv"]
    sensordata: Float[Array, "nsensordata"]
    energy: Float[Array, "2"]
    contact: ContactReport
    status: Status


@full_precision
def step(model: Model, state: State, ctrl: Float[Array, "nu"] | None = None) -> State:
    """Advance one environment by one timestep.

    Args:
      model: the model.
      state: the state; make one with `make_state`.
      ctrl: controls; None means zeros.

    Returns:
      The next state.

    Raises:
      ValueError: an array has the wrong shape.
    """
    return whole_step(model, state, ctrl).after


@full_precision
def whole_step(model: Model, state: State, ctrl: Float[Array, "nu"] | None = None) -> Step:
    """`step`, and where forces were evaluated last; see `jaxsim.engine.integrate.Step`."""
    _check_shapes(model, state, ctrl)
    now = evaluate(model, state, ctrl)
    found = integrate_step(
        model, state, now.instant(), lambda s: evaluate(model, s, ctrl).instant()
    )
    # The warm start changes how fast the solution is found, not the solution.
    return found.replace(after=found.after.replace(qacc_warmstart=lax.stop_gradient(found.qacc)))


@full_precision
def forward(model: Model, state: State, ctrl: Float[Array, "nu"] | None = None) -> Forward:
    """Everything at this instant, nothing integrated: MuJoCo's `mj_forward`.

    Args:
      model: the model.
      state: the state.
      ctrl: controls; None means zeros.

    Raises:
      ValueError: an array has the wrong shape.
    """
    _check_shapes(model, state, ctrl)
    now = evaluate(model, state, ctrl)
    smooth, kin, found = now.smooth, now.smooth.kin, now.constrained
    qacc_smooth = solve_mass(model, kin, smooth.qfrc_smooth)
    energy = jnp.stack(
        [
            potential_energy(model, kin, state.qpos),
            kinetic_energy(model, kin, smooth.vel, state.qvel),
        ]
    )
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
        qfrc_bias=generalized_force(model, kin, smooth.inertial_force),
        qfrc_passive=smooth.passive.qfrc_passive,
        qfrc_actuator=smooth.actuation.qfrc_actuator,
        qfrc_smooth=smooth.qfrc_smooth,
        qfrc_constraint=found.qfrc_constraint,
        actuator_length=smooth.actuation.actuator_length,
        actuator_velocity=smooth.actuation.actuator_velocity,
        actuator_force=smooth.actuation.actuator_force,
        act_dot=smooth.actuation.act_dot,
        qacc_smooth=qacc_smooth,
        qacc=found.qacc,
        sensordata=read_sensors(model, state, now, energy),
        energy=energy,
        contact=_contact_report(now.contact, found.contact_force),
        status=_status(now, qacc_smooth),
    )


@full_precision
def inverse(model: Model, state: State, qacc: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """External forces that explain an acceleration, constraints included: `mj_inverse`.

    `M qacc + qfrc_bias - qfrc_passive - J^T f(qacc)`: given the acceleration, the constraint
    forces are explicit. Equals applied plus actuator forces where `qacc` is that of `forward`.

    Args:
      model: the model.
      state: the state.
      qacc: acceleration.
    """
    _check_shapes(model, state, None)
    smooth = smooth_dynamics(model, state, None)
    scene, contact = constraint_scene(model, state, smooth.kin, smooth.vel)
    found = constrained_at(scene, contact, qacc)
    acceleration = link_accelerations(model, smooth.kin, smooth.vel, qacc)
    force = link_forces(model, smooth.kin, smooth.vel, acceleration)
    needed = generalized_force(model, smooth.kin, force) + dof_armature(model) * qacc
    return needed - smooth.passive.qfrc_passive - found.qfrc_constraint


@full_precision
def rollout(model: Model, state: State, ctrls: Float[Array, "T nu"]) -> tuple[State, State]:
    """`step` over a sequence of controls, as one `lax.scan`.

    Args:
      model: the model.
      state: where to start.
      ctrls: controls of each step.

    Returns:
      The final state, and the states after each step stacked along a leading axis.

    Raises:
      ValueError: an array has the wrong shape.
    """
    if jnp.ndim(ctrls) != 2 or ctrls.shape[1] != model.nu:
        raise ValueError(f"ctrls must have shape (steps, {model.nu}), got {jnp.shape(ctrls)}")

    # The model is closed over: what is known about it while tracing stays known.
    advance = checkpoint(lambda state, ctrl: step(model, state, ctrl))

    def body(state, ctrl):
        state = advance(state, ctrl)
        return state, state

    return lax.scan(body, state, ctrls)


def _check_shapes(model: Model, state: State, ctrl) -> None:
    expected = {
        "qpos": (model.nq,),
        "qvel": (model.nv,),
        "act": (model.na,),
        "xfrc_applied": (model.nbody, 6),
        "qfrc_applied": (model.nv,),
        "mocap_pos": (model.nmocap, 3),
        "mocap_quat": (model.nmocap, 4),
    }
    for name, shape in expected.items():
        if jnp.shape(getattr(state, name)) != shape:
            raise ValueError(
                f"state.{name} must have shape {shape}, got {jnp.shape(getattr(state, name))}; "
                "batches go through jax.vmap or jaxsim.vmap"
            )
    if ctrl is not None and jnp.shape(ctrl) != (model.nu,):
        raise ValueError(
            f"ctrl must have shape ({model.nu},) or be None, got {jnp.shape(ctrl)}; batches go "
            "through jax.vmap or jaxsim.vmap"
        )


def _contact_report(contact: Contact, force: Float[Array, "nc 6"]) -> ContactReport:
    return ContactReport(
        dist=contact.dist,
        pos=contact.pos,
        frame=contact.frame,
        geom1=jnp.asarray(contact.geom1),
        geom2=jnp.asarray(contact.geom2),
        force=force,
        active=contact.active,
    )


def _status(now: Evaluation, qacc_smooth: Float[Array, "nv"]) -> Status:
    solver = now.constrained.status
    # What the solver leaves out of `1/2 |qacc - qacc_smooth|_M^2`, as it does not vary.
    constant = 0.5 * now.smooth.qfrc_smooth @ qacc_smooth
    return Status(
        iterations=solver.iterations,
        residual=solver.residual,
        cost=solver.cost + constant,
        finite=solver.finite,
        contact_overflow=now.contact.overflow,
    )
