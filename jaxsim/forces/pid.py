"""PID servos.

    force = kp (q* - q) + kv (v* - v) + ki z + feedforward,    dz/dt = q* - q

for a length q and a velocity v. The rate of the setpoint q* may be limited, and the integral z may
stop to grow beyond a limit. MuJoCo documentation, XML reference, section "actuator/pid".
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.forces.controller import (
    FEEDFORWARD,
    INTEGRAL,
    POSITION,
    SETPOINT,
    VELOCITY,
    Controlled,
    Drive,
    controlled,
    integral_rate,
    read_states,
    setpoint_rate,
    with_gain,
    with_limited_setpoint,
)
from jaxsim.forces.servo import nearest_setpoint
from jaxsim.model import Model

PID = int(mujoco.mjtGain.mjGAIN_PID)


def pid_rates(model: Model, drive: Drive) -> Float[Array, "n 5"]:
    """Rates of the states of all PID servos."""
    ids = with_gain(model, PID)
    c, (limit, slew) = controlled(model, ids, drive), take(model.actuator_dynprm, ids).T[:2]
    rate = setpoint_rate(model, ids, c, slew)
    c = with_limited_setpoint(model, ids, c, rate)
    wound = integral_rate(_setpoint(model, ids, c) - c.length, c.states[:, INTEGRAL], limit)
    rates = jnp.zeros_like(c.states)
    return rates.at[:, SETPOINT].set(rate).at[:, INTEGRAL].set(wound)


def pid_forces(
    model: Model, drive: Drive, act_dot: Float[Array, "na"], early: Float[Array, "na"]
) -> Float[Array, "n"]:
    """Forces of all PID servos.

    Args:
      model: the model.
      drive: controls, activations, lengths and velocities.
      act_dot: rates of the activations.
      early: activations, after the time step for actuators with `actearly`.
    """
    ids = with_gain(model, PID)
    rate = read_states(model, ids, act_dot)[:, SETPOINT]
    c = with_limited_setpoint(model, ids, controlled(model, ids, drive), rate)
    integral = read_states(model, ids, early)[:, INTEGRAL]
    constant, stiffness, damping = take(model.actuator_biasprm, ids).T[:3]
    ki = take(model.actuator_gainprm[:, 0], ids)
    return (
        constant
        + stiffness * (c.length - _setpoint(model, ids, c))
        + damping * (c.velocity - c.inputs[:, VELOCITY])
        + c.inputs[:, FEEDFORWARD]
        + ki * integral
    )


def _setpoint(model: Model, ids: np.ndarray, c: Controlled) -> Float[Array, "n"]:
    return nearest_setpoint(model, ids, c.inputs[:, POSITION], c.length)
