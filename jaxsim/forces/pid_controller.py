"""PID controllers, as of MuJoCo's plugin `mujoco.pid`.

    force = kp e + ki z + kd (u' - v),    e = u - q,    dz/dt = e

for a length q, a velocity v and a setpoint u: the control, or the state of the actuator's own
dynamics with the rate u'; a control has none. The integral is of the end of the time step. Its
force stays within a limit, and the setpoint moves no further in a time step than a limit allows.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather_or_zero, take
from jaxsim.forces.controller import Drive, Part
from jaxsim.model import Model

INTEGRAL, SETPOINT, OWN = range(3)


class _Aim(NamedTuple):
    """Setpoint, error and integral of the error of n controllers."""

    setpoint: Float[Array, "n"]
    error: Float[Array, "n"]
    integral: Float[Array, "n"]


def controller_rates(model: Model, drive: Drive) -> Part:
    """Rates of the integrals and of the limited setpoints, which reach them in one time step."""
    aim, before = _aim(model, drive, drive.act), _states(model, drive.act)
    after = jnp.stack([aim.integral, aim.setpoint], axis=1)
    rates = (after - before[:, :OWN]) / model.opt.timestep
    address = model.pid_stateadr[:, :OWN].ravel()
    (present,) = np.nonzero(address >= 0)
    return address[present], take(rates.ravel(), present)


def controller_forces(
    model: Model, drive: Drive, act_dot: Float[Array, "na"], early: Float[Array, "na"]
) -> Part:
    """Forces of all PID controllers.

    Args:
      model: the model.
      drive: controls, activations, lengths and velocities.
      act_dot: rates of the activations.
      early: activations, after the time step for actuators with `actearly`.
    """
    ids = model.pid_actuator
    kp, ki, kd, _, _ = take(model.actuator_pid, ids).T
    aim = _aim(model, drive, early)
    slope = _states(model, act_dot)[:, OWN] - take(drive.velocity, ids)
    return ids, kp * aim.error + ki * aim.integral + kd * slope


def _aim(model: Model, drive: Drive, act: Float[Array, "na"]) -> _Aim:
    """What the controllers aim at; setpoints of their own dynamics are among the activations."""
    ids, h, states = model.pid_actuator, model.opt.timestep, _states(model, drive.act)
    _, ki, _, imax, slewmax = take(model.actuator_pid, ids).T
    has = model.pid_stateadr >= 0
    # The plugin clamps controls even where the model disables that.
    low, high = take(model.actuator_ctrlrange, ids).T
    ctrl = take(drive.ctrl, ids)
    limited = np.asarray(model.actuator_ctrllimited, bool)[ids]
    ctrl = jnp.where(limited, jnp.clip(ctrl, low, high), ctrl)
    setpoint = jnp.where(has[:, OWN], _states(model, act)[:, OWN], ctrl)
    # There is no setpoint before the first time step.
    before, most = states[:, SETPOINT], slewmax * h
    near = jnp.clip(setpoint, before - most, before + most)
    setpoint = jnp.where(has[:, SETPOINT] & (drive.time > 0), near, setpoint)
    error = setpoint - take(drive.length, ids)
    bound = imax / jnp.where(ki == 0, 1.0, ki)
    integral = states[:, INTEGRAL] + h * error
    integral = jnp.where(model.pid_windup, jnp.clip(integral, -bound, bound), integral)
    return _Aim(setpoint, error, jnp.where(has[:, INTEGRAL], integral, 0))


def _states(model: Model, act: Float[Array, "na"]) -> Float[Array, "n 3"]:
    """The states of all controllers among the activations or their rates."""
    return gather_or_zero(act, model.pid_stateadr.ravel()).reshape(-1, 3)
