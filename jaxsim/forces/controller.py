"""What PID servos and DC motors share: several controls and activations, limits of their rates.

Each has up to four inputs (setpoints of position and velocity, feedforward, voltage) and up to
five states; `jaxsim.io.actuators` says which. Those that an actuator does not have are zero.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather_or_zero, take
from jaxsim.forces.servo import nearest_setpoint
from jaxsim.model import Model

POSITION, VELOCITY, FEEDFORWARD, VOLTAGE = range(4)
SETPOINT, INTEGRAL, TEMPERATURE, BRISTLE, CURRENT = range(5)


@struct.dataclass
class Drive:
    """What actuators respond to.

    Attributes:
      ctrl: controls, clamped to their ranges.
      act: activations.
      length: lengths of the transmissions.
      velocity: their rates.
      time: the time (s).
    """

    ctrl: Float[Array, "nu"]
    act: Float[Array, "na"]
    length: Float[Array, "nout"]
    velocity: Float[Array, "nout"]
    time: Float[Array, ""]


class Controlled(NamedTuple):
    """Inputs, states, lengths and velocities of n actuators; `has` is static."""

    inputs: Float[Array, "n 4"]
    states: Float[Array, "n 5"]
    has: np.ndarray
    length: Float[Array, "n"]
    velocity: Float[Array, "n"]


Part = tuple[np.ndarray, Array]
"""Rows of an array, and their static indices."""


def with_gain(model: Model, gain: int) -> np.ndarray:
    """Actuators with a type of gain, a number of `mujoco.mjtGain`; static."""
    return np.nonzero(model.actuator_gaintype == gain)[0]


def controlled(model: Model, ids: np.ndarray, drive: Drive) -> Controlled:
    """The record of some actuators."""
    output = model.actuator_outadr[ids]
    return Controlled(
        inputs=gather_or_zero(drive.ctrl, model.actuator_inputadr[ids].ravel()).reshape(-1, 4),
        states=read_states(model, ids, drive.act),
        has=model.actuator_stateadr[ids] >= 0,
        length=take(drive.length, output),
        velocity=take(drive.velocity, output),
    )


def read_states(model: Model, ids: np.ndarray, act: Float[Array, "na"]) -> Float[Array, "n 5"]:
    """The states of some actuators among the activations or their rates."""
    return gather_or_zero(act, model.actuator_stateadr[ids].ravel()).reshape(-1, 5)


def setpoint_rate(
    model: Model, ids: np.ndarray, c: Controlled, limit: Float[Array, "n"]
) -> Float[Array, "n"]:
    """Rates with which the limited setpoints follow the first inputs within one time step."""
    h, before = model.opt.timestep, c.states[:, SETPOINT]
    wanted = nearest_setpoint(model, ids, c.inputs[_first(model, ids)], before)
    return (jnp.clip(wanted, before - limit * h, before + limit * h) - before) / h


def with_limited_setpoint(
    model: Model, ids: np.ndarray, c: Controlled, rate: Float[Array, "n"]
) -> Controlled:
    """The inputs with the limited setpoint after the time step in place of the first of them."""
    limited = c.has[:, SETPOINT]
    if not limited.any():
        return c
    first, after = _first(model, ids), c.states[:, SETPOINT] + model.opt.timestep * rate
    return c._replace(
        inputs=c.inputs.at[first].set(jnp.where(limited, after, c.inputs[first])),
    )


def integral_rate(
    error: Float[Array, "n"], integral: Float[Array, "n"], limit: Float[Array, "n"]
) -> Float[Array, "n"]:
    """The error, zero where it would wind up an integral beyond a positive limit."""
    above = (limit > 0) & (integral >= limit)
    below = (limit > 0) & (integral <= -limit)
    return jnp.where(above, jnp.minimum(error, 0), jnp.where(below, jnp.maximum(error, 0), error))


def as_activations(model: Model, ids: np.ndarray, states: Float[Array, "n 5"]) -> Part:
    """Those of the states that the actuators have, and their addresses in `act`."""
    address = model.actuator_stateadr[ids].ravel()
    (present,) = np.nonzero(address >= 0)
    return address[present], take(states.ravel(), present)


def in_order(parts: list[Part]) -> Array:
    """The array that some parts make up together."""
    index = np.concatenate([index for index, _ in parts])
    return take(jnp.concatenate([rows for _, rows in parts]), np.argsort(index))


def _first(model: Model, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place of each actuator's first input."""
    return np.arange(len(ids)), np.argmax(model.actuator_inputadr[ids] >= 0, axis=1)
