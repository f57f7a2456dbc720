"""What was measured: trajectories, and how they are cut into windows."""

import csv
import pathlib
import re
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.joints.coordinates import difference_pos
from jaxsim.model import Model
from jaxsim.sysid.errors import SysidError


class Recording(NamedTuple):
    """One measured trajectory, sampled at equal intervals.

    Attributes:
      qpos: (T, nq) coordinates.
      ctrl: (T, nu) controls from each sample to the next, or (T - 1, nu); None for zeros.
      qvel: (T, nv) velocities; None if they were not measured.
      act: (T, na) activations of actuators that have dynamics; None for zeros.
    """

    qpos: np.ndarray
    ctrl: np.ndarray | None = None
    qvel: np.ndarray | None = None
    act: np.ndarray | None = None


@struct.dataclass
class Windows:
    """Pieces of recordings with a common number of samples L.

    Attributes:
      qpos: measured coordinates.
      qvel: measured velocities, or differences of coordinates.
      act: activations at the first sample.
      ctrl: controls between the samples.
      weight: one for each sample that counts, zero for one that an earlier window has.
      has_qvel: whether velocities were measured.
    """

    qpos: Float[Array, "W L nq"]
    qvel: Float[Array, "W L nv"]
    act: Float[Array, "W na"]
    ctrl: Float[Array, "W L-1 nu"]
    weight: Float[Array, "W L"]
    has_qvel: Float[Array, "W"]


def read_npz(path: str | pathlib.Path) -> list[Recording]:
    """Recordings from a file of `numpy.savez` with arrays `qpos`, `ctrl`, `qvel`, `act`.

    With one more leading axis they are a batch of trajectories, such as `jaxsim.batch_rollout`
    makes.
    """
    with np.load(path) as file:
        arrays = {name: file[name] for name in Recording._fields if name in file}
    if "qpos" not in arrays:
        raise SysidError(f"{path} has no array 'qpos'")
    if arrays["qpos"].ndim == 2:
        return [Recording(**arrays)]
    count = len(arrays["qpos"])
    return [Recording(**{n: a[i] for n, a in arrays.items()}) for i in range(count)]


def read_csv(path: str | pathlib.Path) -> Recording:
    """A recording from columns `qpos_0`, `qpos_1`, ..., `qvel_0`, ..., `ctrl_0`, ..., in any order.

    Other columns are ignored; a row is a sample.
    """
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    columns: dict[str, dict[int, list[float]]] = {}
    for name in rows[0] if rows else ():
        match = re.fullmatch(r"(qpos|qvel|ctrl|act)_(\d+)", name.strip())
        if match:
            values = [_number(path, row[name]) for row in rows]
            columns.setdefault(match[1], {})[int(match[2])] = values
    if "qpos" not in columns:
        raise SysidError(f"{path} has no columns qpos_0, qpos_1, ...")
    return Recording(
        **{name: np.array([found[i] for i in sorted(found)]).T for name, found in columns.items()}
    )


def _number(path, text: str) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        raise SysidError(f"{path} has {text!r} where a number is expected") from None


def admit_recordings(model: Model, data: Recording | Sequence[Recording]) -> list[Recording]:
    """Recordings with all arrays, of the right shapes and finite.

    Raises:
      SysidError: they are not.
    """
    data = [data] if isinstance(data, Recording) else list(data)
    if not data:
        raise SysidError("there are no recordings")
    return [_admitted(model, recording, f"recording {i}") for i, recording in enumerate(data)]


def _admitted(model: Model, recording: Recording, who: str) -> Recording:
    if not isinstance(recording, Recording):
        raise SysidError(f"{who} is no jaxsim.sysid.Recording but {type(recording).__name__}")
    qpos = np.asarray(recording.qpos, float)
    length = len(qpos)
    if length < 2:
        raise SysidError(f"{who} has fewer than two samples")
    ctrl = np.zeros((length - 1, model.nu)) if recording.ctrl is None else recording.ctrl
    ctrl = np.asarray(ctrl, float)[: length - 1]
    act = np.zeros((length, model.na)) if recording.act is None else np.asarray(recording.act)
    found = {"qpos": (qpos, (length, model.nq)), "ctrl": (ctrl, (length - 1, model.nu))}
    found["act"] = act, (length, model.na)
    if recording.qvel is not None:
        found["qvel"] = np.asarray(recording.qvel, float), (length, model.nv)
    for name, (array, shape) in found.items():
        if array.shape != shape:
            raise SysidError(f"{who}: {name} must have shape {shape}, got {array.shape}")
        if not np.isfinite(array).all():
            raise SysidError(f"{who}: {name} has numbers that are not finite")
    return Recording(**{name: array for name, (array, _) in found.items()})


def cut(model: Model, data: Sequence[Recording], length: int | None, interval: float) -> Windows:
    """All recordings as windows of one length.

    Args:
      model: the model.
      data: what `admit_recordings` returns.
      length: samples in a window; None, or more than there are, for the shortest recording.
      interval: time between samples (s).

    Raises:
      SysidError: the length is below two.
    """
    shortest = min(len(r.qpos) for r in data)
    length = shortest if length is None else min(length, shortest)
    if length < 2:
        raise SysidError(f"a window needs two samples, got {length}")
    pieces = [piece for r in data for piece in _pieces(model, r, length, interval)]
    arrays = [np.stack(a) for a in zip(*pieces, strict=True)]
    return Windows(*(jnp.asarray(a, model.qpos0.dtype) for a in arrays))


def _pieces(model: Model, r: Recording, length: int, interval: float):
    """Windows one after the other; the last one overlaps and counts what is left."""
    qvel = _velocities(model, r.qpos, interval) if r.qvel is None else r.qvel
    ctrl, act = np.asarray(r.ctrl), np.asarray(r.act)
    for begin in range(0, len(r.qpos), length):
        first = min(begin, len(r.qpos) - length)
        part = slice(first, first + length)
        weight = (np.arange(first, first + length) >= begin).astype(float)
        measured = float(r.qvel is not None)
        controls = ctrl[first : first + length - 1]
        yield r.qpos[part], qvel[part], act[first], controls, weight, measured


def _velocities(model: Model, qpos: np.ndarray, interval: float) -> np.ndarray:
    """Central differences of the coordinates."""
    ahead = np.minimum(np.arange(len(qpos)) + 1, len(qpos) - 1)
    behind = np.maximum(np.arange(len(qpos)) - 1, 0)
    move = jax.jit(jax.vmap(lambda a, b: difference_pos(model, a, b)))
    return np.asarray(move(qpos[behind], qpos[ahead])) / ((ahead - behind) * interval)[:, None]
