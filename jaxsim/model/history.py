"""Where the samples of delayed controls and sensors are kept, and the first samples.

The layout of `State.history` is that of MuJoCo's `mjData.history`. Each actuator or sensor with
samples has a buffer of one tick, one number that is not used here, n times, and n values, the
oldest first. Times are relative to `State.time`, so that they keep their digits in float32. The
tick of a sensor with an interval is the time at which it was due last.
"""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


@dataclasses.dataclass(frozen=True)
class Buffers:
    """Buffers of one size, of actuators or of sensors; static.

    Attributes:
      ids: (m,) actuators or sensors.
      sensors: whether they are sensors.
      start: (m,) first number of each buffer.
      count: number of samples.
      dim: numbers in a sample.
      order: how the signal is interpolated, as in `jaxsim.arrays.samples`.
    """

    ids: np.ndarray
    sensors: bool
    start: np.ndarray
    count: int
    dim: int
    order: int

    @property
    def times(self) -> np.ndarray:
        """(m, n) places of the times."""
        return self.start[:, None] + 2 + np.arange(self.count)

    @property
    def values(self) -> np.ndarray:
        """(m, n * dim) places of the values."""
        return self.start[:, None] + 2 + self.count + np.arange(self.count * self.dim)


def buffers(model: Any) -> list[Buffers]:
    """All buffers of a model, grouped."""
    if not model.nhistory:
        return []
    return [
        *_grouped(model.actuator_history, model.actuator_historyadr, model.actuator_ctrlnum, False),
        *_grouped(model.sensor_history, model.sensor_historyadr, model.sensor_dim, True),
    ]


def _grouped(samples, address, dim, sensors: bool) -> list[Buffers]:
    keys = np.column_stack([samples[:, 0], dim, samples[:, 1]])
    found = []
    for key in np.unique(keys[samples[:, 0] > 0], axis=0):
        (ids,) = np.nonzero((keys == key).all(axis=1))
        found.append(Buffers(ids, sensors, address[ids], *key.tolist()))
    return found


def time_places(model: Any) -> Bool[np.ndarray, "nhistory"]:
    """Which numbers of a history are times relative to the present; static."""
    found = np.zeros(model.nhistory, bool)
    for group in buffers(model):
        found[group.times] = True
        if group.sensors:
            found[group.start[model.sensor_periodic[group.ids]]] = True
    return found


def initial_history(model: Any) -> Float[Array, "nhistory"] | None:
    """Samples of zeros at the times before the start, as `mj_resetData` takes them.

    None if no actuator has a delay, and no sensor a delay or an interval.
    """
    if not model.nhistory:
        return None
    h = model.opt.timestep
    history = jnp.zeros(model.nhistory, h.dtype)
    for group in buffers(model):
        before = -jnp.arange(group.count, 0, -1, dtype=h.dtype)
        times = jnp.broadcast_to(h * before, group.times.shape)
        ticks = jnp.zeros(len(group.ids), h.dtype)
        if group.sensors:
            ticks, times = _first_ticks(model, group, times)
        history = history.at[group.start].set(ticks).at[group.start + 1].set(group.count - 1)
        history = history.at[group.times].set(times)
    return history


def history_of(model: Any, history: np.ndarray, time: float) -> Float[Array, "nhistory"] | None:
    """The history of a state from MuJoCo's `mjData.history`, whose buffers are rings.

    Args:
      model: the model.
      history: MuJoCo's, which the second number of each buffer says where to begin.
      time: of the state.
    """
    if not model.nhistory:
        return None
    found = np.array(history, float)
    for group in buffers(model):
        for start, times, values in zip(group.start, group.times, group.values, strict=True):
            newest = int(found[start + 1])
            oldest_first = np.roll(np.arange(group.count), -newest - 1)
            found[times] = found[times][oldest_first]
            rows = found[values].reshape(group.count, group.dim)
            found[values] = rows[oldest_first].ravel()
            found[start + 1] = group.count - 1
    return jnp.asarray(found - np.where(time_places(model), time, 0), model.qpos0.dtype)


def _first_ticks(model: Any, group: Buffers, times):
    """Ticks and times of the samples of sensors; those with an interval are computed at ticks."""
    h = model.opt.timestep
    period, phase = model.sensor_interval[group.ids].T
    periodic = model.sensor_periodic[group.ids]
    tick = jnp.where(phase == 0, -period, phase)
    ago = jnp.arange(group.count - 1, -1, -1, dtype=h.dtype)
    steps = jnp.ceil((tick[:, None] - ago[None] * period[:, None]) / h)
    return (
        jnp.where(periodic, tick, -h),
        jnp.where(jnp.asarray(periodic)[:, None], steps * h, times),
    )
