"""Actuators: from controls to forces.

`force = gain(length, velocity) * input + bias(length, velocity)`, where the input is the control
or, for an actuator with dynamics, its activation. MuJoCo documentation, chapter Computation,
section "Actuation model". PID servos, PID controllers, DC motors and servos of orientations have
files of their own.
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.arrays.kinds import apply_by_kind
from jaxsim.collision import Contact
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.transmission import (
    TENDON,
    Transmission,
    actuator_velocity,
    force_on_joints,
    transmission,
)
from jaxsim.forces.activation import activation_rate, next_activation, scalar_actuators
from jaxsim.forces.adhesion import with_adhesion
from jaxsim.forces.controller import Drive, Part, in_order, with_gain
from jaxsim.forces.dc_motor import DCMOTOR, mechanical_forces, motor_forces, motor_slopes
from jaxsim.forces.muscle import muscle_bias, muscle_gain
from jaxsim.forces.orientation import SO3, force_rows, limited_torques, torques
from jaxsim.forces.pid import PID, pid_forces
from jaxsim.forces.pid_controller import controller_forces
from jaxsim.forces.servo import nearest_setpoint
from jaxsim.model import Model

_CLAMPCTRL = mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION


Paths = tuple[Float[Array, "nout"], Float[Array, "nout"]]
"""Lengths of the actuators and their rates."""


@struct.dataclass
class Actuation:
    """State of the actuators at one instant; names are MuJoCo's.

    Attributes:
      transmission: lengths and moments.
      actuator_velocity: rates of the lengths.
      actuator_input: activation of each of the `scalar_actuators` with dynamics, clamped control of
        the others.
      actuator_force: forces along the actuators.
      qfrc_actuator: generalised forces.
      act_dot: rates of the activations.
      motor_slope: derivatives of the forces of DC motors by their velocities.
    """

    transmission: Transmission
    actuator_velocity: Float[Array, "nout"]
    actuator_input: Float[Array, "nscalar"]
    actuator_force: Float[Array, "nout"]
    qfrc_actuator: Float[Array, "nv"]
    act_dot: Float[Array, "na"]
    motor_slope: Float[Array, "nmotor"]

    @property
    def actuator_length(self) -> Float[Array, "nout"]:
        """Lengths of the actuators."""
        return self.transmission.length

    @property
    def paths(self) -> Paths:
        """Lengths of the actuators and their rates."""
        return self.actuator_length, self.actuator_velocity


def actuation(
    model: Model,
    kin: Kinematics,
    qpos: Float[Array, "nq"],
    qvel: Float[Array, "nv"],
    act: Float[Array, "na"],
    ctrl: Float[Array, "nu"] | None,
    qfrc_gravcomp: Float[Array, "nv"],
    contact: Contact | None = None,
    time: Float[Array, ""] | float = 0.0,
) -> Actuation:
    """Forces of all actuators and rates of their activations; zero if actuation is disabled.

    Args:
      model: the model.
      kin: its kinematics.
      qpos: coordinates.
      qvel: velocities.
      act: activations.
      ctrl: controls; None for zero.
      qfrc_gravcomp: gravity compensation; actuators exert it on joints with `actgravcomp`.
      contact: the contacts, which actuators of bodies act through.
      time: the time (s); at zero there is no earlier setpoint that limits the next.
    """
    t = transmission(model, kin, qpos)
    t = t if contact is None else with_adhesion(model, kin, t, contact)
    zeros = jnp.zeros_like(t.length)
    if not model.nactuator or model.opt.disabled(_ACTUATION):
        none = zeros[:0]
        qfrc, rates = jnp.zeros_like(qvel), jnp.zeros_like(act)
        return Actuation(t, zeros, none, zeros, qfrc, rates, none)
    velocity, motors = actuator_velocity(model, t, qvel), len(with_gain(model, DCMOTOR)) > 0
    ctrl = jnp.zeros(model.nu, act.dtype) if ctrl is None else ctrl
    drive = Drive(clamp_ctrl(model, ctrl), act, t.length, velocity, jnp.asarray(time))
    act_dot = activation_rate(model, drive)
    early = _early_activations(model, drive, act_dot)
    used = _inputs(model, early, drive.ctrl)
    force = _forces(model, drive, act_dot, early, used)
    return Actuation(
        transmission=t,
        actuator_velocity=velocity,
        actuator_input=used,
        actuator_force=force,
        qfrc_actuator=_joint_forces(model, t, force, qfrc_gravcomp),
        act_dot=act_dot,
        motor_slope=motor_slopes(model, drive) if motors else zeros[:0],
    )


def clamp_ctrl(model: Model, ctrl: Float[Array, "nu"]) -> Float[Array, "nu"]:
    """Controls clamped to the ranges of actuators with limited control."""
    if model.opt.disabled(_CLAMPCTRL):
        return ctrl
    return _clip(ctrl, model.actuator_ctrlrange, model.actuator_ctrllimited)


def disabled_actuators(model: Model) -> np.ndarray:
    """(nactuator,) whether each actuator belongs to a disabled group; static."""
    group = np.asarray(model.actuator_group)
    known = (group >= 0) & (group <= 30)
    return known & (((model.opt.disableactuator >> np.where(known, group, 0)) & 1) == 1)


def _early_activations(model: Model, drive: Drive, act_dot) -> Float[Array, "na"]:
    """Activations, those of actuators with `actearly` after the time step."""
    early = np.asarray(model.actuator_actearly, bool)[model.structure.act_actuator]
    if not early.any():
        return drive.act
    after = next_activation(model, drive.act, act_dot, drive.velocity, model.opt.timestep)
    return jnp.where(early, after, drive.act)


def _inputs(model: Model, act, ctrl) -> Float[Array, "nscalar"]:
    """Factor of each gain: the activation of an actuator that has one, else its control."""
    ids = scalar_actuators(model)
    stateful = model.actuator_actnum[ids] > 0
    if not stateful.any():
        return take(ctrl, model.actuator_ctrladr[ids])
    of_act, of_ctrl = model.nu + model.actuator_actadr[ids], model.actuator_ctrladr[ids]
    return take(jnp.concatenate([ctrl, act]), np.where(stateful, of_act, of_ctrl))


def _forces(model: Model, drive: Drive, act_dot, early, used) -> Float[Array, "nout"]:
    motors = with_gain(model, DCMOTOR)
    parts = [_scalar_forces(model, drive, used)]
    if len(servos := with_gain(model, PID)):
        force = pid_forces(model, drive, act_dot, early)
        parts.append((model.actuator_outadr[servos], force))
    if len(model.pid_actuator):
        parts.append(controller_forces(model, drive, act_dot, early))
    if len(motors):
        force = motor_forces(model, drive, act_dot, early)
        parts.append((model.actuator_outadr[motors], force))
    if len(rows := force_rows(model)):
        parts.append((rows, torques(model, drive, early)))
    force = _limited(model, _without_disabled(model, in_order(parts)))
    if len(motors):
        # The limit is one of the current.
        mechanical = mechanical_forces(model, drive, act_dot)
        force = force.at[model.actuator_outadr[motors]].add(mechanical, unique_indices=True)
        force = _without_disabled(model, force)
    return force


def _scalar_forces(model: Model, drive: Drive, used) -> Part:
    ids = scalar_actuators(model)
    rows = model.actuator_outadr[ids]
    length, velocity = take(drive.length, rows), take(drive.velocity, rows)
    setpoint = nearest_setpoint(model, ids, used, length)
    return rows, gains(model, length, velocity) * setpoint + _biases(model, length, velocity)


def _without_disabled(model: Model, force) -> Float[Array, "nout"]:
    off = disabled_actuators(model)
    off[model.pid_actuator] = False  # MuJoCo runs plugins of disabled groups, too
    off = off[model.structure.out_actuator]
    return jnp.where(off, 0, force) if off.any() else force


def _limited(model: Model, force) -> Float[Array, "nout"]:
    """Forces within the ranges of their tendons and of their own."""
    owner = model.structure.out_actuator
    scalar = np.asarray(model.actuator_forcelimited, bool) & (model.actuator_gaintype != SO3)
    force = _limit_tendons(model, force)
    force = _clip(force, take(model.actuator_forcerange, owner), scalar[owner])
    return limited_torques(model, force)


def gains(
    model: Model, length: Float[Array, "nscalar"], velocity: Float[Array, "nscalar"]
) -> Float[Array, "nscalar"]:
    """Force of each of the `scalar_actuators` for a unit of input, without the bias."""
    kinds = {
        int(mujoco.mjtGain.mjGAIN_FIXED): lambda prm, *_: prm[0],
        int(mujoco.mjtGain.mjGAIN_AFFINE): lambda prm, x, v, *_: _affine(prm, x, v),
        int(mujoco.mjtGain.mjGAIN_MUSCLE): lambda prm, x, v, span, acc0: muscle_gain(
            x, v, span, acc0, prm
        ),
    }
    return _by_kind(model, "gain", kinds, length, velocity)


def _biases(model: Model, length, velocity) -> Float[Array, "nscalar"]:
    kinds = {
        int(mujoco.mjtBias.mjBIAS_NONE): lambda prm, *_: jnp.zeros_like(prm[0]),
        int(mujoco.mjtBias.mjBIAS_AFFINE): lambda prm, x, v, *_: _affine(prm, x, v),
        int(mujoco.mjtBias.mjBIAS_MUSCLE): lambda prm, x, _, span, acc0: muscle_bias(
            x, span, acc0, prm
        ),
    }
    return _by_kind(model, "bias", kinds, length, velocity)


def _by_kind(model: Model, what: str, kinds, length, velocity) -> Float[Array, "nscalar"]:
    """Gains or biases of the scalar actuators."""
    ids = scalar_actuators(model)
    rows = model.actuator_outadr[ids]
    return apply_by_kind(
        getattr(model, f"actuator_{what}type")[ids],
        kinds,
        take(getattr(model, f"actuator_{what}prm"), ids),
        length,
        velocity,
        take(model.actuator_lengthrange, rows),
        take(model.actuator_acc0, rows),
        empty=length,
    )


def _affine(prm, length, velocity):
    return prm[0] + prm[1] * length + prm[2] * velocity


def _limit_tendons(model: Model, force) -> Float[Array, "nout"]:
    """Scale the forces of actuators of limited tendons so that each tendon's sum is in range."""
    (on_tendon,) = np.nonzero(model.actuator_trntype == TENDON)
    tendon = model.actuator_trnid[on_tendon, 0]
    limited = np.asarray(model.tendon_actfrclimited, bool)[tendon]
    if not limited.any():
        return force
    ids, tendon = model.actuator_outadr[on_tendon[limited]], tendon[limited]
    total = take(sum_by(take(force, ids), tendon, model.ntendon), tendon)
    low, high = take(model.tendon_actfrcrange, tendon).T
    outside = (total < low) | (total > high)
    # A total of zero cannot be scaled.
    outside = outside & (total != 0)
    ratio = jnp.clip(total, low, high) / jnp.where(outside, total, 1.0)
    scaled = take(force, ids) * jnp.where(outside, ratio, 1.0)
    return force.at[ids].set(scaled, unique_indices=True)


def _joint_forces(model: Model, t: Transmission, force, gravcomp) -> Float[Array, "nv"]:
    """Generalised forces with gravity compensation by actuators, clamped to the joints' limits."""
    qfrc = force_on_joints(model, t, force)
    exerted = np.asarray(model.jnt_actgravcomp, bool)[model.dof_jntid]
    if exerted.any():
        qfrc = qfrc + jnp.where(exerted, gravcomp, 0)
    limited = np.asarray(model.jnt_actfrclimited, bool)
    if not limited.any():
        return qfrc
    dofs = model.jnt_dofadr[limited]
    low, high = take(model.jnt_actfrcrange, np.nonzero(limited)[0]).T
    return qfrc.at[dofs].set(jnp.clip(take(qfrc, dofs), low, high))


def _clip(x, interval, limited):
    """Clip x to the interval where the static mask `limited` is true."""
    limited = np.asarray(limited, bool)
    if not limited.any():
        return x
    clipped = jnp.clip(x, interval[:, 0], interval[:, 1])
    return clipped if limited.all() else jnp.where(limited, clipped, x)
