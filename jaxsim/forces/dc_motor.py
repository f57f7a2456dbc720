"""DC motors.

    force = K i + A sin(N q + phi) - sigma0 z - sigma1 dz/dt,
    te di/dt = V / R - K v / R - i           (or i = (V - K v) / R without inductance),
    dz/dt = v - sigma0 |v| z / g(v),         g(v) = F_C + (F_S - F_C) exp(-(v / v_S)^2),
    C dT/dt = R i^2 - T / RT,                R = R0 (1 + alpha (T + Ta - T0)),

for a length q and a velocity v: torque of the current, cogging, LuGre friction and heating. The
voltage V is an input, or that of a controller of the torque. MuJoCo documentation, XML reference,
section "actuator/dcmotor".
"""

from typing import NamedTuple

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.forces.controller import (
    BRISTLE,
    CURRENT,
    FEEDFORWARD,
    INTEGRAL,
    POSITION,
    SETPOINT,
    TEMPERATURE,
    VELOCITY,
    VOLTAGE,
    Controlled,
    Drive,
    as_activations,
    controlled,
    integral_rate,
    read_states,
    setpoint_rate,
    with_gain,
    with_limited_setpoint,
)
from jaxsim.model import Model

DCMOTOR = int(mujoco.mjtGain.mjGAIN_DCMOTOR)


class _Motor(NamedTuple):
    """Parameters of n motors; `controls` is static."""

    resistance: Float[Array, "n"]
    constant: Float[Array, "n"]
    tempcoef: Float[Array, "n"]
    reftemp: Float[Array, "n"]
    gains: Float[Array, "3 n"]
    max_voltage: Float[Array, "n"]
    timeconst: Float[Array, "n"]
    max_current_rate: Float[Array, "n"]
    thermal_resistance: Float[Array, "n"]
    thermal_capacitance: Float[Array, "n"]
    ambient: Float[Array, "n"]
    bristle_stiffness: Float[Array, "n"]
    bristle_damping: Float[Array, "n"]
    max_setpoint_rate: Float[Array, "n"]
    max_integral: Float[Array, "n"]
    cogging: Float[Array, "3 n"]
    friction: Float[Array, "3 n"]
    controls: np.ndarray


def motor_rates(model: Model, drive: Drive) -> Float[Array, "n 5"]:
    """Rates of the states of all motors."""
    ids = with_gain(model, DCMOTOR)
    motor, c = _motor(model, ids), controlled(model, ids, drive)
    slew = setpoint_rate(model, ids, c, motor.max_setpoint_rate)
    c = with_limited_setpoint(model, ids, c, slew)
    error = c.inputs[:, POSITION] - c.length
    wound = integral_rate(error, c.states[:, INTEGRAL], motor.max_integral)
    driven = _driven_current(motor, c)
    current = jnp.where(c.has[:, CURRENT], c.states[:, CURRENT], driven)
    changed = (driven - c.states[:, CURRENT]) / _or_one(c, CURRENT, motor.timeconst)
    most = jnp.where(motor.max_current_rate > 0, motor.max_current_rate, jnp.inf)
    lost = c.states[:, TEMPERATURE] / _or_one(c, TEMPERATURE, motor.thermal_resistance)
    heat = _resistance(motor, c) * current * current - lost
    warmed = heat / _or_one(c, TEMPERATURE, motor.thermal_capacitance)
    bent = c.velocity - _bristle_decay(motor, c.velocity) * c.states[:, BRISTLE]
    return jnp.stack([slew, wound, warmed, bent, jnp.clip(changed, -most, most)], axis=1)


def motor_forces(
    model: Model, drive: Drive, act_dot: Float[Array, "na"], early: Float[Array, "na"]
) -> Float[Array, "n"]:
    """Forces of the currents of all motors.

    Args:
      model: the model.
      drive: controls, activations, lengths and velocities.
      act_dot: rates of the activations.
      early: activations after the time step.
    """
    ids = with_gain(model, DCMOTOR)
    motor, c = _motor(model, ids), controlled(model, ids, drive)
    rates = read_states(model, ids, act_dot)
    c = with_limited_setpoint(model, ids, c, rates[:, SETPOINT])
    after = read_states(model, ids, early)[:, CURRENT]
    current = jnp.where(c.has[:, CURRENT], after, _driven_current(motor, c))
    return motor.constant * current


def mechanical_forces(model: Model, drive: Drive, act_dot: Float[Array, "na"]) -> Float[Array, "n"]:
    """Cogging and friction of all motors, which do not depend on the current."""
    ids = with_gain(model, DCMOTOR)
    motor, c = _motor(model, ids), controlled(model, ids, drive)
    rates = read_states(model, ids, act_dot)
    amplitude, poles, phase = motor.cogging
    bent = motor.bristle_stiffness * c.states[:, BRISTLE]
    bending = motor.bristle_damping * rates[:, BRISTLE]
    friction = jnp.where(c.has[:, BRISTLE], bent + bending, 0)
    return amplitude * jnp.sin(poles * c.length + phase) - friction


def motor_slopes(model: Model, drive: Drive) -> Float[Array, "n"]:
    """Derivatives of the forces by the velocities, as MuJoCo's implicit integrators take them.

    They are those away from limits of the voltage; of friction, only the damping of the bristles.
    """
    ids = with_gain(model, DCMOTOR)
    motor, c = _motor(model, ids), controlled(model, ids, drive)
    tau = _or_one(c, CURRENT, motor.timeconst)
    share = jnp.where(c.has[:, CURRENT], -jnp.expm1(-model.opt.timestep / tau), 1.0)
    constant, kd = motor.constant, motor.gains[2]
    by_control = constant - kd * motor.resistance / _or_one_of(motor.controls, constant)
    of_voltage = jnp.where(motor.controls, by_control, 0) - constant
    return constant * of_voltage * share / _nonzero(_resistance(motor, c)) - motor.bristle_damping


def limited_states(
    model: Model,
    before: Float[Array, "na"],
    after: Float[Array, "na"],
    velocity: Float[Array, "nout"],
    dt: Float[Array, ""],
) -> Float[Array, "na"]:
    """Activations after a time step, with integrals in their limits and bristles solved exactly.

    Over the time step the bristle's equation is linear for the constant velocity.

    Args:
      model: the model.
      before: activations.
      after: activations after an Euler step.
      velocity: rates of the lengths.
      dt: length of the time step (s).
    """
    ids = with_gain(model, DCMOTOR)
    if not (model.actuator_stateadr[ids] >= 0).any():
        return after
    motor = _motor(model, ids)
    states, bristle = (read_states(model, ids, x) for x in (after, before))
    bound = jnp.where(motor.max_integral > 0, motor.max_integral, jnp.inf)
    states = states.at[:, INTEGRAL].set(jnp.clip(states[:, INTEGRAL], -bound, bound))
    velocity = take(velocity, model.actuator_outadr[ids])
    rate = _bristle_decay(motor, velocity)
    decays = rate > MINVAL
    mean = -jnp.expm1(-rate * dt) / jnp.where(decays, rate, 1.0)
    moved = jnp.exp(-rate * dt) * bristle[:, BRISTLE] + jnp.where(decays, mean, dt) * velocity
    index, values = as_activations(model, ids, states.at[:, BRISTLE].set(moved))
    return after.at[index].set(values, unique_indices=True)


def _motor(model: Model, ids: np.ndarray) -> _Motor:
    gain, dyn, bias = (
        take(prm, ids).T
        for prm in (model.actuator_gainprm, model.actuator_dynprm, model.actuator_biasprm)
    )
    inputs = model.actuator_inputadr[ids]
    return _Motor(
        resistance=gain[0],
        constant=gain[1],
        tempcoef=gain[2],
        reftemp=gain[3],
        gains=gain[4:7],
        max_voltage=gain[7],
        timeconst=dyn[0],
        max_current_rate=dyn[1],
        thermal_resistance=dyn[2],
        thermal_capacitance=dyn[3],
        ambient=dyn[4],
        bristle_stiffness=dyn[5],
        bristle_damping=dyn[6],
        max_setpoint_rate=dyn[7],
        max_integral=dyn[8],
        cogging=bias[:3],
        friction=bias[3:6],
        controls=(inputs[:, [POSITION, VELOCITY, FEEDFORWARD]] >= 0).any(axis=1),
    )


def _driven_current(motor: _Motor, c: Controlled) -> Float[Array, "n"]:
    """The current without inductance, `(V - K v) / R`."""
    return (_voltage(motor, c) - motor.constant * c.velocity) / _nonzero(_resistance(motor, c))


def _voltage(motor: _Motor, c: Controlled) -> Float[Array, "n"]:
    """Voltage of the controller, which compensates back-EMF, and of the input."""
    if not motor.controls.any():
        return c.inputs[:, VOLTAGE]
    kp, ki, kd = motor.gains
    torque = (
        kp * (c.inputs[:, POSITION] - c.length)
        + kd * (c.inputs[:, VELOCITY] - c.velocity)
        + ki * c.states[:, INTEGRAL]
        + c.inputs[:, FEEDFORWARD]
    )
    constant = _or_one_of(motor.controls, motor.constant)
    wanted = motor.resistance / constant * torque + motor.constant * c.velocity
    most = jnp.where(motor.max_voltage > 0, motor.max_voltage, jnp.inf)
    return jnp.where(motor.controls, jnp.clip(wanted, -most, most), 0) + c.inputs[:, VOLTAGE]


def _resistance(motor: _Motor, c: Controlled) -> Float[Array, "n"]:
    """Resistance at the temperature of the winding, a state above the ambient temperature."""
    if not c.has[:, TEMPERATURE].any():
        return motor.resistance
    warmer = c.states[:, TEMPERATURE] + motor.ambient - motor.reftemp
    factor = jnp.where(c.has[:, TEMPERATURE], 1 + motor.tempcoef * warmer, 1.0)
    return motor.resistance * factor


def _bristle_decay(motor: _Motor, velocity: Float[Array, "n"]) -> Float[Array, "n"]:
    """`sigma0 |v| / g(v)`, the rate at which a bristle recovers (1/s)."""
    coulomb, static, stribeck = motor.friction
    ratio = velocity / jnp.maximum(stribeck, MINVAL)
    g = coulomb + (static - coulomb) * jnp.exp(-ratio * ratio)
    return motor.bristle_stiffness * jnp.abs(velocity) / jnp.maximum(g, MINVAL)


def _nonzero(resistance: Float[Array, "n"]) -> Float[Array, "n"]:
    return jnp.maximum(resistance, MINVAL)


def _or_one(c: Controlled, state: int, x: Float[Array, "n"]) -> Float[Array, "n"]:
    """A divisor for the actuators that have a state."""
    return _or_one_of(c.has[:, state], x)


def _or_one_of(has: np.ndarray, x: Float[Array, "n"]) -> Float[Array, "n"]:
    return jnp.where(has, x, 1.0)
