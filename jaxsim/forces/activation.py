"""Activations: the states of actuators that have dynamics."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.arrays.kinds import apply_by_kind
from jaxsim.forces.controller import CURRENT, Drive, Part, as_activations, in_order, with_gain
from jaxsim.forces.dc_motor import DCMOTOR, limited_states, motor_rates
from jaxsim.forces.muscle import muscle_activation_rate
from jaxsim.forces.orientation import SO3, setpoint_rates, setpoint_rows
from jaxsim.forces.pid import PID, pid_rates
from jaxsim.forces.pid_controller import OWN, controller_rates
from jaxsim.model import Model

_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FILTER = int(mujoco.mjtDyn.mjDYN_FILTER)
_FILTEREXACT = int(mujoco.mjtDyn.mjDYN_FILTEREXACT)
_MUSCLE = int(mujoco.mjtDyn.mjDYN_MUSCLE)


def scalar_actuators(model: Model) -> np.ndarray:
    """Actuators with one control, one force and at most one activation; static."""
    others = np.isin(model.actuator_gaintype, (PID, SO3, DCMOTOR))
    others[model.pid_actuator] = True
    return np.nonzero(~others)[0]


def activation_rows(model: Model, ids: np.ndarray) -> np.ndarray:
    """Places in `act` of the states of some actuators' dynamics; static.

    A PID controller has states of its own before it.
    """
    return model.actuator_actadr[ids] + model.actuator_actnum[ids] - 1


def activation_rate(model: Model, drive: Drive) -> Float[Array, "na"]:
    """Rates of the activations.

    They are `ctrl` for integrators, `(ctrl - act) / tau` for filters, and for muscles the same
    with a time constant that depends on `ctrl` and `act`. PID servos, PID controllers and DC motors
    have several.

    Args:
      model: the model.
      drive: controls, activations, lengths and velocities.
    """
    if not model.na:
        return jnp.zeros_like(drive.act)
    parts = [_scalar_rates(model, drive)]
    if len(servos := with_gain(model, PID)):
        parts.append(as_activations(model, servos, pid_rates(model, drive)))
    if len(model.pid_actuator):
        parts.append(controller_rates(model, drive))
    if len(motors := with_gain(model, DCMOTOR)):
        parts.append(as_activations(model, motors, motor_rates(model, drive)))
    if len(rows := setpoint_rows(model)):
        parts.append((rows, setpoint_rates(model, drive)))
    return in_order(parts)


def _scalar_rates(model: Model, drive: Drive) -> Part:
    ids = scalar_actuators(model)
    lagging = model.pid_actuator[model.pid_stateadr[:, OWN] >= 0]
    ids = np.append(ids[model.actuator_actnum[ids] > 0], lagging)

    def lag(u, a, prm):
        return (u - a) / jnp.maximum(prm[0], MINVAL)

    kinds = {
        _INTEGRATOR: lambda u, a, prm: u,
        _FILTER: lag,
        _FILTEREXACT: lag,
        _MUSCLE: muscle_activation_rate,
    }
    rows = activation_rows(model, ids)
    inputs = take(drive.ctrl, model.actuator_ctrladr[ids]), take(drive.act, rows)
    prm = take(model.actuator_dynprm, ids)
    return rows, apply_by_kind(model.actuator_dyntype[ids], kinds, *inputs, prm, empty=inputs[1])


def next_activation(
    model: Model,
    act: Float[Array, "na"],
    act_dot: Float[Array, "na"],
    velocity: Float[Array, "nout"],
    dt: Float[Array, ""],
) -> Float[Array, "na"]:
    """Activations after a time step, within `actrange`.

    This is an Euler step. For exact filters and currents its length is `tau (1 - exp(-dt / tau))`
    instead of dt.

    Args:
      model: the model.
      act: activations.
      act_dot: their rates.
      velocity: rates of the actuators' lengths.
      dt: length of the time step (s).
    """
    if not model.na:
        return act
    ids = model.structure.act_actuator
    step = dt * jnp.ones_like(act)
    exact = (model.actuator_dyntype[ids] == _FILTEREXACT) | (
        model.actuator_stateadr[ids, CURRENT] == np.arange(model.na)
    )
    if exact.any():
        tau = jnp.maximum(take(model.actuator_dynprm[:, 0], ids), MINVAL)
        step = jnp.where(exact, -tau * jnp.expm1(-dt / jnp.where(exact, tau, 1.0)), step)
    stepped = limited_states(model, act, act + act_dot * step, velocity, dt)
    motor = model.actuator_gaintype[ids] == DCMOTOR
    limited = np.asarray(model.actuator_actlimited, bool)[ids] & ~motor
    if not limited.any():
        return stepped
    low, high = take(model.actuator_actrange, ids).T
    return jnp.where(limited, jnp.clip(stepped, low, high), stepped)
