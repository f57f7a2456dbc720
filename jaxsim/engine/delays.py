"""Delays of controls and sensors: what a state remembers of them.

`State.history` has the samples; see `jaxsim.model.history`. In a step, delayed signals are read
first, then the samples of this instant are added, and time advances.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.samples import signal_at
from jaxsim.model import Model, State
from jaxsim.model.history import Buffers, buffers, time_places

# Rounding errors of times, in time steps: a delay of some whole time steps is exactly that.
_ROUNDING = 1e-4


def remembers_sensors(model: Model) -> bool:
    """Whether states keep readings of sensors."""
    return any(group.sensors for group in buffers(model))


def applied_controls(
    model: Model, state: State, ctrl: Float[Array, "nu"] | None
) -> Float[Array, "nu"] | None:
    """The controls that act at an instant: earlier ones for actuators with a delay."""
    if not model.nhistory:
        return ctrl
    ctrl = jnp.zeros(model.nu, state.history.dtype) if ctrl is None else ctrl
    for group in buffers(model):
        late = model.actuator_delayed
        if not group.sensors and late[group.ids].any():
            old = _signals(model, state, group, model.actuator_delay)
            rows = _rows(model.actuator_ctrladr[group.ids], group.dim)
            old = jnp.where(jnp.asarray(late[group.ids])[:, None], old, ctrl[rows])
            ctrl = ctrl.at[rows].set(old, unique_indices=True)
    return ctrl


def reported_readings(
    model: Model, state: State, readings: Float[Array, "nsensordata"]
) -> Float[Array, "nsensordata"]:
    """The readings that sensors report: earlier ones for those with a delay or between intervals.

    Args:
      model: the model.
      state: the state.
      readings: what they would report without.
    """
    for group in buffers(model):
        late, periodic = model.sensor_delayed, model.sensor_periodic
        if not group.sensors or not (late | periodic)[group.ids].any():
            continue
        rows = _rows(model.sensor_adr[group.ids], group.dim)
        old = _signals(model, state, group, model.sensor_delay)
        now = ~late[group.ids] & jnp.asarray(_due(model, state, group))
        reported = jnp.where(now[:, None], readings[rows], old)
        readings = readings.at[rows].set(reported, unique_indices=True)
    return readings


def next_history(
    model: Model,
    state: State,
    ctrl: Float[Array, "nu"] | None,
    readings: Float[Array, "nsensordata"] | None,
) -> Float[Array, "nhistory"] | None:
    """The history after a time step, with the samples of the instant before it.

    Args:
      model: the model.
      state: the state before the time step.
      ctrl: controls of the time step.
      readings: of the sensors, without delays; None if no sensor is remembered.
    """
    if not model.nhistory:
        return None
    history = state.history
    ctrl = jnp.zeros(model.nu, history.dtype) if ctrl is None else ctrl
    for group in buffers(model):
        first = model.sensor_adr if group.sensors else model.actuator_ctrladr
        source: Any = readings if group.sensors else ctrl
        sample = source[_rows(first[group.ids], group.dim)]
        history = _with_samples(model, state, group, history, sample)
    return aged(model, history, model.opt.timestep)


def aged(
    model: Model, history: Float[Array, "nhistory"] | None, time: Float[Array, ""]
) -> Float[Array, "nhistory"] | None:
    """A history after some time without samples."""
    return None if history is None else history - jnp.where(time_places(model), time, 0)


def _signals(model: Model, state: State, group: Buffers, delay) -> Float[Array, "m dim"]:
    """The signals of some buffers, delayed."""
    tolerance = _ROUNDING * model.opt.timestep
    read: Callable = lambda times, values, age: signal_at(  # noqa: E731
        times, values.reshape(group.count, group.dim), -age, group.order, tolerance
    )
    return jax.vmap(read)(
        state.history[group.times], state.history[group.values], take(delay, group.ids)
    )


def _due(model: Model, state: State, group: Buffers) -> Bool[Array, "m"]:
    """Which sensors are computed at this instant."""
    periodic = model.sensor_periodic[group.ids]
    since = state.history[group.start] + take(model.sensor_interval[:, 0], group.ids)
    return jnp.where(periodic, since <= _ROUNDING * model.opt.timestep, True)


def _with_samples(model: Model, state: State, group: Buffers, history, sample):
    """A history with a sample (m, dim) of each of some buffers in place of the oldest one."""
    times, values = state.history[group.times], state.history[group.values]
    moved = jnp.concatenate([times[:, 1:], jnp.zeros_like(times[:, :1])], axis=1)
    shifted = jnp.concatenate([values[:, group.dim :], sample], axis=1)
    if group.sensors and model.sensor_periodic[group.ids].any():
        due = _due(model, state, group)[:, None]
        moved, shifted = jnp.where(due, moved, times), jnp.where(due, shifted, values)
        period = jnp.where(due[:, 0], take(model.sensor_interval[:, 0], group.ids), 0)
        periodic = model.sensor_periodic[group.ids]
        history = history.at[group.start].add(jnp.where(periodic, period, 0), unique_indices=True)
    history = history.at[group.times].set(moved, unique_indices=True)
    return history.at[group.values].set(shifted, unique_indices=True)


def _rows(first: np.ndarray, count: int) -> np.ndarray:
    """(m, count) consecutive places."""
    return first[:, None] + np.arange(count)
