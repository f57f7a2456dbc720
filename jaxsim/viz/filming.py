"""A simulation as a film."""

import pathlib
from collections.abc import Iterator, Sequence

import jax
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.model import Model, State
from jaxsim.viz.batch import batched
from jaxsim.viz.cameras import Camera
from jaxsim.viz.frames import Frames
from jaxsim.viz.models import looks_of
from jaxsim.viz.touch import metres_per_newton, touches
from jaxsim.viz.video import write_video


def film(
    model: Model | mujoco.MjModel,
    trajectory: State,
    path: str | pathlib.Path,
    *,
    camera: Camera = None,
    contacts: bool = False,
    ctrls: Float[Array, "*batch T nu"] | None = None,
    com: bool = False,
    label: str | Sequence[str] = "",
    width: int = 480,
    height: int = 360,
    fps: float = 30.0,
    speed: float = 1.0,
) -> pathlib.Path:
    """Draw a simulation and write it as MP4 or GIF; no screen and no ffmpeg of the system's.

        final, trajectory = jaxsim.rollout(model, state, ctrls)
        jaxsim.viz.film(model, trajectory, "run.mp4", contacts=True)

    Environments of a batch stand side by side. A model without a sky, a floor or a light gets
    them, in the picture only.

    Args:
      model: what was simulated.
      trajectory: states of one environment, stacked (T, ...), or of several (B, T, ...).
      path: file to write; its ending, `.mp4` or `.gif`, is the format. Without an ending: MP4
        where imageio has its ffmpeg, or else GIF.
      camera: name or number of a camera of the model; -1 for a free one that sees everything; a
        `mujoco.MjvCamera`; or None: the camera "track" or one that follows the first body, or for
        a batch one that sees all of it.
      contacts: mark contact points and the forces on the second geom of each.
      ctrls: controls that go with the states, which contact forces depend on; zeros if None.
      com: mark centres of mass, and draw bodies transparent.
      label: text in the upper left corner; or one for each state.
      width: of the picture, in pixels.
      height: of the picture, in pixels.
      fps: frames per second of the film.
      speed: simulated seconds per second of the film.

    Returns:
      The file written.

    Raises:
      ValueError: shapes do not fit together, or an argument is out of range.
      RuntimeError: no OpenGL, or imageio is not installed; the message says what to install.
    """
    if not (fps > 0 and speed > 0):
        raise ValueError(f"fps and speed must be positive, got {fps} and {speed}")
    source = looks_of(model)
    batch = batched(source, trajectory, "trajectory")
    envs, steps = batch.qpos.shape[:2]
    labels = [label] * steps if isinstance(label, str) else list(label)
    if len(labels) != steps:
        raise ValueError(f"label must be one text, or {steps} of them, got {len(labels)}")
    kept = frames_at(np.asarray(batch.time[0]), speed / fps)
    found = touches(model, batch, ctrls, kept) if contacts else []
    drawing = Frames(source, width, height, camera, envs=envs, com=com)
    scale = metres_per_newton(found, drawing.scene.extent)

    def pictures() -> Iterator[np.ndarray]:
        for count, step in enumerate(kept):
            states = jax.tree.map(lambda x, step=step: x[:, step], batch)
            rows = [touch.at(count) for touch in found]
            yield drawing.frame(states, rows, scale, labels[step])

    try:
        return write_video(pictures(), path, fps)
    finally:
        drawing.close()


def frames_at(times: np.ndarray, period: float) -> np.ndarray:
    """Indices of the states shown: the last that is not after each frame's time."""
    count = int((times[-1] - times[0]) / period + 1e-3) + 1
    shown = times[0] + period * np.arange(count)
    return np.clip(np.searchsorted(times, shown + 1e-3 * period, "right") - 1, 0, len(times) - 1)
