"""A simulation as one HTML file that plays in a browser, offline."""

import base64
import dataclasses
import html as escaping
import importlib.resources
import json
import math
import pathlib
import re
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.model import Model, State
from jaxsim.viz.batch import batched, places
from jaxsim.viz.drawing import drawing, moving_bodies, xyzw
from jaxsim.viz.models import looks_of
from jaxsim.viz.touch import Touch, metres_per_newton, touches
from jaxsim.viz.viewpoint import positions, travel, viewpoint

# Frames are left out, evenly, where the poses would be more numbers than this (2 MB of the page).
MAX_NUMBERS = 400_000


@dataclasses.dataclass(frozen=True)
class Page:
    """An HTML page.

    A notebook shows it where it is the value of a cell.

    Attributes:
      text: the whole page.
    """

    text: str

    def save(self, path: str | pathlib.Path) -> pathlib.Path:
        """Write the page to a file, and return its path."""
        path = pathlib.Path(path)
        path.write_text(self.text, encoding="utf-8")
        return path

    def _repr_html_(self, height: int = 480) -> str:
        page = escaping.escape(self.text, quote=True)
        style = f"width: 100%; height: {height}px; border: 0"
        return f'<iframe srcdoc="{page}" style="{style}"></iframe>'

    def __repr__(self) -> str:
        return f"Page of {len(self.text) / 1e6:.1f} MB; .save(path) writes it"


def html(
    model: Model | mujoco.MjModel,
    trajectory: State,
    *,
    contacts: bool = False,
    ctrls: Float[Array, "*batch T nu"] | None = None,
    quantities: Mapping[str, Array] | None = None,
    ghost: State | None = None,
    title: str = "",
) -> Page:
    """A page that plays a simulation: orbit, scrub, speed, centre of mass, contact forces, plots.

        final, trajectory = jaxsim.rollout(model, state, ctrls)
        jaxsim.viz.html(model, trajectory).save("run.html")

    The page is one file and needs no network. Environments of a batch stand side by side.

    Args:
      model: what was simulated.
      trajectory: states of one environment, stacked (T, ...), or of several (B, T, ...).
      contacts: also show contact points and the forces on the second geom of each. They are
        computed by `jaxsim.forward`, which has to compile.
      ctrls: controls that go with the states, which contact forces depend on; zeros if None.
      quantities: arrays (T,) or (T, k) to plot under the cursor, by name; of the first environment
        where there are several.
      ghost: a second trajectory of the same shape, drawn transparent.
      title: shown above the picture.

    Returns:
      The page.

    Raises:
      ValueError: shapes do not fit together.
    """
    source = looks_of(model)
    batch = batched(source, trajectory, "trajectory")
    envs, steps = batch.qpos.shape[:2]
    stride = _stride(envs, steps, 7 * len(moving_bodies(source)), ghost is not None)
    kept = np.arange(0, steps, stride)
    numbers = _Numbers()
    poses, start = _poses(source, batch, kept)
    drawn = drawing(source, start)
    stands = places(envs, drawn.extent)
    follow = bool(envs == 1 and travel(poses[0]) > drawn.extent)
    record = {
        "times": numbers.add(np.asarray(batch.time)[0, kept]),
        "geoms": drawn.geoms,
        "surfaces": [
            {"points": numbers.add(s.points), "faces": numbers.add(s.faces)} for s in drawn.surfaces
        ],
        "moving": drawn.moving.tolist(),
        "poses": [numbers.add(p) for p in poses],
        "places": stands.tolist(),
        "ghosts": [numbers.add(p) for p in _ghost_poses(source, ghost, batch, kept)],
        "com": [numbers.add(p) for p in _centers_of_mass(source, poses, drawn.moving)],
        "series": _series(numbers, quantities or {}, steps, kept),
        "extent": drawn.extent,
        "tile": 10 ** round(math.log10(drawn.extent)) / 2,
        "follow": follow,
        "camera": viewpoint(source, poses, drawn, stands, follow),
        "force": 0.0,
        "contacts": [],
    }
    if contacts:
        found = touches(model, batch, ctrls, kept)
        record |= _contacts(numbers, found, drawn.extent)
    record["numbers"] = numbers.encoded()
    return Page(_filled(title, record))


class _Numbers:
    """One block of float32 numbers; what is added is found again by its start and length."""

    def __init__(self) -> None:
        self._parts: list[np.ndarray] = []
        self._length = 0

    def add(self, array: Any) -> tuple[int, int]:
        part = np.ascontiguousarray(array, "<f4").ravel()
        start, self._length = self._length, self._length + part.size
        self._parts.append(part)
        return start, part.size

    def encoded(self) -> str:
        return base64.b64encode(b"".join(p.tobytes() for p in self._parts)).decode()


def _stride(envs: int, steps: int, numbers: int, twice: bool) -> int:
    total = envs * steps * numbers * (2 if twice else 1)
    return max(1, math.ceil(total / MAX_NUMBERS))


def _poses(source: mujoco.MjModel, batch: State, kept: np.ndarray):
    """(B, T, moving bodies, 7) positions and quaternions, scalar last; data of the first state."""
    data, moving = mujoco.MjData(source), moving_bodies(source)
    poses = np.zeros((batch.qpos.shape[0], len(kept), len(moving), 7))
    for env in reversed(range(len(poses))):
        for frame, step in reversed(list(enumerate(kept))):
            data.qpos[:] = batch.qpos[env, step]
            if source.nmocap:
                data.mocap_pos[:] = batch.mocap_pos[env, step]
                data.mocap_quat[:] = batch.mocap_quat[env, step]
            mujoco.mj_kinematics(source, data)
            poses[env, frame] = np.concatenate([data.xpos, xyzw(data.xquat)], axis=1)[moving]
    return poses, data


def _ghost_poses(source: mujoco.MjModel, ghost: State | None, batch: State, kept: np.ndarray):
    if ghost is None:
        return []
    states = batched(source, ghost, "ghost")
    if states.qpos.shape != batch.qpos.shape:
        raise ValueError(
            f"ghost.qpos must have the shape of trajectory.qpos, {batch.qpos.shape}, "
            f"got {states.qpos.shape}"
        )
    return _poses(source, states, kept)[0]


def _centers_of_mass(source: mujoco.MjModel, poses: np.ndarray, moving: np.ndarray):
    """(B, T, 3) centres of mass of all that moves; nothing where that has no mass."""
    mass = source.body_mass[moving]
    if not mass.sum() > 0:
        return []
    return np.einsum("m,...mk->...k", mass / mass.sum(), positions(poses, source.body_ipos[moving]))


def _series(numbers: _Numbers, quantities: Mapping[str, Array], steps: int, kept: np.ndarray):
    entries = []
    for name, value in quantities.items():
        array = np.asarray(value, float)
        if array.ndim not in (1, 2) or len(array) != steps:
            raise ValueError(
                f"quantities[{name!r}] must have shape ({steps},) or ({steps}, k), "
                f"got {array.shape}"
            )
        entries.append({"name": name, "values": numbers.add(array[kept])})
    return entries


def _contacts(numbers: _Numbers, found: list[Touch], extent: float):
    """Points and forces (world axes) of each frame's contacts, and the length of a newton."""
    entries = [
        {
            "first": numbers.add(touch.first),
            "rows": numbers.add(touch.rows),
            "most": int(np.diff(touch.first).max(initial=0)),
        }
        for touch in found
    ]
    return {"contacts": entries, "force": metres_per_newton(found, extent)}


def _filled(title: str, record: dict[str, Any]) -> str:
    """The page's template with its parts in their places."""
    parts = {
        "title": escaping.escape(title) or "jaxsim",
        "style": _web("viewer.css"),
        "data": json.dumps(record, separators=(",", ":")).replace("</", "<\\/"),
        "three": _web("three.min.js"),
        "viewer": _web("viewer.js"),
    }
    return re.sub(r"@(\w+)@", lambda found: parts[found[1]], _web("viewer.html"))


def _web(name: str) -> str:
    return (importlib.resources.files("jaxsim.viz") / "web" / name).read_text(encoding="utf-8")
