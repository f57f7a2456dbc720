"""Frames of a simulation as arrays of pixels."""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from jaxsim.model import Model, State
from jaxsim.viz.cameras import Camera
from jaxsim.viz.canvas import Canvas
from jaxsim.viz.models import looks_of
from jaxsim.viz.scene import Scene


class Frames:
    """Draws states of one model; the renderer is made when the first frame is asked for.

    Where no camera is named, the one called "track" is used, or else one that follows the first
    body from a distance at which everything that moves is seen. A model without a sky, a floor or
    a light gets them, in the picture only.

    Attributes:
      model: what is drawn.
      scene: how it is drawn.
    """

    def __init__(
        self,
        model: Model | mujoco.MjModel,
        width: int = 480,
        height: int = 480,
        camera: Camera = None,
        *,
        envs: int = 1,
        com: bool = False,
    ):
        """Remember what to draw, and how large.

        Args:
          model: of one environment, drawn with the looks of its source; or MuJoCo's own model.
          width: of a frame, in pixels.
          height: of a frame, in pixels.
          camera: name or number of a camera; -1 for a free one that sees the whole model; or a
            `mujoco.MjvCamera`.
          envs: how many environments stand side by side.
          com: mark centres of mass, and draw bodies transparent.

        Raises:
          ValueError: the size is not positive, or there is no such camera.
        """
        if min(width, height) < 1:
            raise ValueError(f"width and height must be positive, got {width} x {height}")
        self.model = copy.copy(looks_of(model))
        self.scene = Scene(self.model, envs, camera, com)
        self._data = [mujoco.MjData(self.model) for _ in range(envs)]
        self._size = width, height
        self._canvas: Canvas | None = None

    def frame(
        self,
        state: State,
        contacts: Sequence[np.ndarray] = (),
        scale: float = 0.0,
        label: str = "",
    ) -> np.ndarray:
        """The picture of a state, shape (height, width, 3), bytes.

        Args:
          state: of one environment, or stacked (B, ...) where there are several.
          contacts: of each environment, points and forces (n, 6) to mark, world axes (m, N).
          scale: length of an arrow for each newton (m/N).
          label: text in the upper left corner.

        Raises:
          RuntimeError: MuJoCo has no OpenGL to draw with.
        """
        canvas = self._canvas = self._canvas or Canvas(self.model, *self._size)
        if np.ndim(state.qpos) == 1:
            data = [self.pose(state)]
        else:
            rows = zip(state.qpos, state.mocap_pos, state.mocap_quat, strict=True)
            data = [self._posed(env, *row) for env, row in enumerate(rows)]
        return canvas.draw(self.scene.fill(data, contacts, scale), label)

    def pose(self, state: State) -> mujoco.MjData:
        """The data of a state of one environment, with all that is drawn in place."""
        return self._posed(0, state.qpos, state.mocap_pos, state.mocap_quat)

    def _posed(self, env: int, qpos, mocap_pos, mocap_quat) -> mujoco.MjData:
        data = self._data[env]
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, mocap_pos, mocap_quat
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data

    def close(self) -> None:
        """Free the renderer; the next frame makes a new one."""
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None
