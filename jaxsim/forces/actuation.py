"""Actuators: from controls to forces.

`force = gain(length, velocity) * input + bias(length, velocity)`, where the input is the control
or, for an actuator with dynamics, its activation. MuJoCo documentation, chapter Computation,
section "Actuation model".
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
from jaxsim.forces.activation import activation_rate, next_activation, stateful_actuators
from jaxsim.forces.adhesion import with_adhesion
from jaxsim.forces.muscle import muscle_bias, muscle_gain
from jaxsim.forces.servo import wrap_setpoint
from jaxsim.model import Model

_CLAMPCTRL = mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION


@struct.dataclass
class Actuation:
    """State of the actuators at one instant; names are MuJoCo's.

    Attributes:
      transmission: lengths and moments.
      actuator_velocity: rates of the lengths.
      actuator_input: activation of each actuator with dynamics, clamped control of the others.
      actuator_force: forces along the actuators.
      qfrc_actuator: generalised forces.
      act_dot: rates of the activations.
    """

    transmission: Transmission
    actuator_velocity: Float[Array, "nu"]
    actuator_input: Float[Array, "nu"]
    actuator_force: Float[Array, "nu"]
    qfrc_actuator: Float[Array, "nv"]
    act_dot: Float[Array, "na"]

    @property
    def actuator_length(self) -> Float[Array, "nu"]:
        """Lengths of the actuators."""
        return self.transmission.length


def actuation(
    model: Model,
    kin: Kinematics,
    qpos: Float[Array, "nq"],
    qvel: Float[Array, "nv"],
    act: Float[Array, "na"],
    ctrl: Float[Array, "nu"] | None,
    qfrc_gravcomp: Float[Array, "nv"],
    contact: Contact | None = None,
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
    """
    t = transmission(model, kin, qpos)
    t = t if contact is None else with_adhesion(model, kin, t, contact)
    zeros = jnp.zeros_like(t.length)
    if not model.nu or model.opt.disabled(_ACTUATION):
        return Actuation(t, zeros, zeros, zeros, jnp.zeros_like(qvel), jnp.zeros_like(act))
    velocity = actuator_velocity(model, t, qvel)
    ctrl = zeros if ctrl is None else ctrl
    clamped = clamp_ctrl(model, ctrl)
    act_dot = activation_rate(model, act, clamped)
    used = _inputs(model, act, act_dot, clamped)
    force = _forces(model, t.length, velocity, wrap_setpoint(model, used, t.length))
    return Actuation(
        transmission=t,
        actuator_velocity=velocity,
        actuator_input=used,
        actuator_force=force,
        qfrc_actuator=_joint_forces(model, t, force, qfrc_gravcomp),
        act_dot=act_dot,
    )


def clamp_ctrl(model: Model, ctrl: Float[Array, "nu"]) -> Float[Array, "nu"]:
    """Controls clamped to the ranges of actuators with limited control."""
    if model.opt.disabled(_CLAMPCTRL):
        return ctrl
    return _clip(ctrl, model.actuator_ctrlrange, model.actuator_ctrllimited)


def disabled_actuators(model: Model) -> np.ndarray:
    """(nu,) whether each actuator belongs to a disabled group; static."""
    group = np.asarray(model.actuator_group)
    known = (group >= 0) & (group <= 30)
    return known & (((model.opt.disableactuator >> np.where(known, group, 0)) & 1) == 1)


def _inputs(model: Model, act, act_dot, ctrl) -> Float[Array, "nu"]:
    """Factor of each gain: the activation of an actuator that has one, else its control."""
    ids = stateful_actuators(model)
    if not len(ids):
        return ctrl
    early = np.asarray(model.actuator_actearly, bool)[ids]
    state = act
    if early.any():
        state = jnp.where(early, next_activation(model, act, act_dot, model.opt.timestep), act)
    position = np.arange(model.nu)
    position[ids] = model.nu + np.arange(len(ids))
    return take(jnp.concatenate([ctrl, state]), position)


def _forces(model: Model, length, velocity, control) -> Float[Array, "nu"]:
    force = gains(model, length, velocity) * control + _biases(model, length, velocity)
    off = disabled_actuators(model)
    if off.any():
        force = jnp.where(off, 0, force)
    force = _limit_tendons(model, force)
    return _clip(force, model.actuator_forcerange, model.actuator_forcelimited)


def gains(
    model: Model, length: Float[Array, "nu"], velocity: Float[Array, "nu"]
) -> Float[Array, "nu"]:
    """(nu,) force for a unit of input, without the bias."""
    kinds = {
        int(mujoco.mjtGain.mjGAIN_FIXED): lambda prm, *_: prm[0],
        int(mujoco.mjtGain.mjGAIN_AFFINE): lambda prm, x, v, *_: _affine(prm, x, v),
        int(mujoco.mjtGain.mjGAIN_MUSCLE): lambda prm, x, v, span, acc0: muscle_gain(
            x, v, span, acc0, prm
        ),
    }
    ranges, acc0 = model.actuator_lengthrange, model.actuator_acc0
    return apply_by_kind(
        model.actuator_gaintype,
        kinds,
        model.actuator_gainprm,
        length,
        velocity,
        ranges,
        acc0,
        empty=length,
    )


def _biases(model: Model, length, velocity) -> Float[Array, "nu"]:
    kinds = {
        int(mujoco.mjtBias.mjBIAS_NONE): lambda prm, *_: jnp.zeros_like(prm[0]),
        int(mujoco.mjtBias.mjBIAS_AFFINE): lambda prm, x, v, *_: _affine(prm, x, v),
        int(mujoco.mjtBias.mjBIAS_MUSCLE): lambda prm, x, _, span, acc0: muscle_bias(
            x, span, acc0, prm
        ),
    }
    ranges, acc0 = model.actuator_lengthrange, model.actuator_acc0
    return apply_by_kind(
        model.actuator_biastype,
        kinds,
        model.actuator_biasprm,
        length,
        velocity,
        ranges,
        acc0,
        empty=length,
    )


def _affine(prm, length, velocity):
    return prm[0] + prm[1] * length + prm[2] * velocity


def _limit_tendons(model: Model, force) -> Float[Array, "nu"]:
    """Scale the forces of actuators of limited tendons so that each tendon's sum is in range."""
    (on_tendon,) = np.nonzero(model.actuator_trntype == TENDON)
    tendon = model.actuator_trnid[on_tendon, 0]
    limited = np.asarray(model.tendon_actfrclimited, bool)[tendon]
    if not limited.any():
        return force
    ids, tendon = on_tendon[limited], tendon[limited]
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
