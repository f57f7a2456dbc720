"""One episode as a video, for `jaxsim train` and `jaxsim play`."""

import contextlib
import os
import pathlib
import sys
from typing import Any

import jax
import numpy as np
from mujoco.rendering.classic import gl_context

from jaxsim.envs.bridges.render import frames as frames_of
from jaxsim.viz.video import write_video

MAX_STEPS = 1000
SLOWEST = 30.0  # frames per second that are enough for a video


def save_video(env: Any, policy: Any, path: pathlib.Path, seed: int) -> str:
    """Play and draw one episode; returns what to tell the user."""
    _draw_without_screen()
    try:
        frames, fps = _frames(env, policy, seed)
        return f"video: {write_video(frames, path, fps)}"
    except RuntimeError as error:
        return f"no video: {error}"


def _frames(env: Any, policy: Any, seed: int) -> tuple[list[np.ndarray], float]:
    reset, step = jax.jit(env.reset), jax.jit(lambda s: env.step(s, policy(s.obs)))
    drawing = frames_of(env, 480, 480, None)
    state = reset(jax.random.key(seed))
    frames = [drawing.frame(jax.device_get(state.state))]  # fails early where nothing can draw
    every = max(1, round(1 / (SLOWEST * float(env.dt))))
    for count in range(1, MAX_STEPS + 1):
        state = step(state)
        if count % every == 0:
            frames.append(drawing.frame(jax.device_get(state.state)))
        if state.terminated or state.truncated:
            break
    drawing.close()
    return frames, 1 / (float(env.dt) * every)


def _draw_without_screen() -> None:
    """Let MuJoCo draw by EGL where there is no screen and the user has said nothing.

    It has made its choice when it was imported, before anything of ours could run.
    """
    said = any(name in os.environ for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and not said:
        with contextlib.suppress(ImportError, AttributeError, RuntimeError):
            from mujoco.egl import GLContext

            gl_context.GLContext = GLContext
