"""`forward_details`: what MuJoCo's and MJX's `Data` hold beyond the fields of `Forward`."""

from typing import Any

from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.dynamics.tendons.tendon import tendon_jacobian, tendon_velocity
from jaxsim.dynamics.transmission import actuator_moment
from jaxsim.engine.instant import Instant
from jaxsim.engine.readout import body_wrenches
from jaxsim.engine.report import Forward, report
from jaxsim.engine.rows import ConstraintRows, constraint_rows
from jaxsim.engine.stepping import evaluate
from jaxsim.model import Model, State
from jaxsim.model.inputs import admit
from jaxsim.quantities import body_forces
from jaxsim.quantities.cameras import camera_frames
from jaxsim.quantities.joint_frames import joint_frames
from jaxsim.quantities.momentum import subtree_velocities
from jaxsim.quantities.motion_axes import cdof, cdof_dot


@struct.dataclass
class ForwardDetails(Forward, ConstraintRows):
    """`Forward`, and the quantities from which MuJoCo computes it; names and order are MuJoCo's.

    Spatial vectors are (angular, linear) in world axes about the centre of mass of the body's tree,
    `subtree_com[body_rootid]`.

    All rows that the model can have are listed, with D zero where MuJoCo would not list them: these
    rows are zero but for `efc_pos` and `efc_margin`. Rows of contacts are in the order of
    `contact`, whose slots are their `efc_id`.

    Attributes:
      xanchor: anchors of joints (m).
      xaxis: their axes.
      ximat: orientations of the inertial frames.
      cam_xpos: positions of cameras (m).
      cam_xmat: their axes; they look along their negative z axes.
      cinert: inertias of bodies: six moments, mass times position, mass.
      crb: the same of their subtrees.
      cdof: motion axes.
      cdof_dot: rates of the motion axes.
      cvel: twists of bodies.
      cacc: their spatial accelerations minus gravity.
      cfrc_int: wrenches that bodies receive from their parents.
      cfrc_ext: external wrenches: contacts, connects, welds and `xfrc_applied`.
      subtree_linvel: velocities of the centres of mass of subtrees (m/s).
      subtree_angmom: angular momenta of subtrees about their centres of mass (N m s).
      ten_length: lengths of tendons.
      ten_velocity: their rates.
      ten_J: their Jacobian.
      actuator_moment: Jacobian of the lengths of actuators.
      qfrc_spring: forces of springs of joints and tendons.
      qfrc_damper: forces of dampers.
      qfrc_gravcomp: gravity compensation, that of actuators included.
      qfrc_fluid: drag.
      qfrc_adhesion: pull of surfaces that adhere.
      efc_type: numbers of `mujoco.mjtConstraint`.
      efc_id: equality, degree of freedom, joint, tendon or slot of the contact.
      efc_J: Jacobian.
      efc_pos: position: violation, distance to a limit, distance of a contact.
      efc_margin: positions below which rows are active.
      efc_frictionloss: largest dry friction.
      efc_D: inverse regularisation `1 / R`.
      efc_vel: `efc_J qvel`.
      efc_aref: reference acceleration.
      efc_force: force; that of all rows is `qfrc_constraint = efc_J^T efc_force`.
    """

    xanchor: Float[Array, "njnt 3"]
    xaxis: Float[Array, "njnt 3"]
    ximat: Float[Array, "nbody 3 3"]
    cam_xpos: Float[Array, "ncam 3"]
    cam_xmat: Float[Array, "ncam 3 3"]
    cinert: Float[Array, "nbody 10"]
    crb: Float[Array, "nbody 10"]
    cdof: Float[Array, "nv 6"]
    cdof_dot: Float[Array, "nv 6"]
    cvel: Float[Array, "nbody 6"]
    cacc: Float[Array, "nbody 6"]
    cfrc_int: Float[Array, "nbody 6"]
    cfrc_ext: Float[Array, "nbody 6"]
    subtree_linvel: Float[Array, "nbody 3"]
    subtree_angmom: Float[Array, "nbody 3"]
    ten_length: Float[Array, "ntendon"]
    ten_velocity: Float[Array, "ntendon"]
    ten_J: Float[Array, "ntendon nv"]
    actuator_moment: Float[Array, "nout nv"]
    qfrc_spring: Float[Array, "nv"]
    qfrc_damper: Float[Array, "nv"]
    qfrc_gravcomp: Float[Array, "nv"]
    qfrc_fluid: Float[Array, "nv"]
    qfrc_adhesion: Float[Array, "nv"]


@full_precision
def forward_details(
    model: Model, state: State, ctrl: Float[Array, "nu"] | None = None
) -> ForwardDetails:
    """`forward`, with the com-based and the constraint quantities of MuJoCo's and MJX's `Data`.

    Call it inside `jax.jit` and return what you need: what is not used is not computed.

    Args:
      model: the model.
      state: the state.
      ctrl: controls; None means zeros.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, state, ctrl = admit(model, state, ctrl)
    now = evaluate(model, state, ctrl)
    plain, rows = report(now, state), constraint_rows(now.motion, now.constrained)
    return ForwardDetails(
        **vars(plain),
        **vars(rows),
        **_frames(now, state),
        **_spatial(now, state),
        **_lengths(now, state),
        **_passive(now),
    )


def _frames(now: Instant, state: State) -> dict[str, Any]:
    """Where joints and cameras are."""
    model, kin = now.motion.model, now.motion.kin
    xanchor, xaxis = joint_frames(model, kin, state.qpos)
    cam_xpos, cam_xmat = camera_frames(model, kin)
    return {
        "xanchor": xanchor,
        "xaxis": xaxis,
        "ximat": kin.ximat,
        "cam_xpos": cam_xpos,
        "cam_xmat": cam_xmat,
    }


def _passive(now: Instant) -> dict[str, Any]:
    """The parts of the passive force."""
    names = "qfrc_spring qfrc_damper qfrc_gravcomp qfrc_fluid qfrc_adhesion".split()
    return {name: getattr(now.passive, name) for name in names}


def _spatial(now: Instant, state: State) -> dict[str, Any]:
    """Com-based quantities of bodies and degrees of freedom."""
    motion = now.motion
    model, kin, vel = motion.model, motion.kin, motion.vel
    wrench = body_wrenches(motion, state, now.constrained)
    moving = {
        "cvel": body_forces.cvel(model, kin, vel),
        "cacc": body_forces.cacc(model, kin, vel, now.qacc),
        "cfrc_ext": body_forces.cfrc_ext(model, kin, wrench),
    }
    inertia = body_forces.body_inertias(model, kin)
    linvel, angmom = subtree_velocities(model, kin, vel)
    return moving | {
        "cinert": body_forces.cinert(model, kin),
        "crb": body_forces.crb(model, kin),
        "cdof": cdof(model, kin),
        "cdof_dot": cdof_dot(model, kin, vel, state.qvel),
        "cfrc_int": body_forces.cfrc_int(model, inertia, **moving),
        "subtree_linvel": linvel,
        "subtree_angmom": angmom,
    }


def _lengths(now: Instant, state: State) -> dict[str, Any]:
    """Lengths of tendons and actuators as functions of the coordinates."""
    model, kin = now.motion.model, now.motion.kin
    return {
        "ten_length": kin.ten_length,
        "ten_velocity": tendon_velocity(model, kin, state.qvel),
        "ten_J": tendon_jacobian(model, kin),
        "actuator_moment": actuator_moment(model, now.actuation.transmission),
    }
