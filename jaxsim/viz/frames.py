"""Frames of a simulation as arrays of pixels."""

import mujoco
import numpy as np

from jaxsim.io import to_mujoco
from jaxsim.model import Model, State

_NO_OPENGL = (
    "MuJoCo cannot draw because it found no OpenGL: start Python with MUJOCO_GL=egl in the "
    "environment (or MUJOCO_GL=osmesa where there is no graphics driver)"
)


class Frames:
    """Draws states of one model; the renderer is made when the first frame is asked for.

    Where no camera is named, the one called "track" is used, or else one that follows the first
    body from a distance at which everything that moves is seen.

    Attributes:
      model: what is drawn.
    """

    def __init__(
        self,
        model: Model | mujoco.MjModel,
        width: int = 480,
        height: int = 480,
        camera: int | str | None = None,
    ):
        """Remember what to draw, and how large.

        Args:
          model: of one environment, drawn with the looks of its source; or MuJoCo's own model.
          width: of a frame, in pixels.
          height: of a frame, in pixels.
          camera: name or number of a camera; -1 for a free one that sees the whole model.

        Raises:
          ValueError: the size is not positive, or there is no such camera.
        """
        if min(width, height) < 1:
            raise ValueError(f"width and height must be positive, got {width} x {height}")
        self.model = to_mujoco(model) if isinstance(model, Model) else model
        self._data = mujoco.MjData(self.model)
        self._size, self._camera = (height, width), _camera(self.model, camera)
        self._renderer: mujoco.Renderer | None = None

    def frame(self, state: State) -> np.ndarray:
        """The picture of a state of one environment, shape (height, width, 3), bytes.

        Raises:
          RuntimeError: MuJoCo has no OpenGL to draw with.
        """
        renderer = self._renderer = self._renderer or _renderer(self.model, self._size)
        renderer.update_scene(self.pose(state), camera=self._camera)
        return renderer.render()

    def pose(self, state: State) -> mujoco.MjData:
        """The scene of a state, with all that is drawn in place."""
        data = self._data
        data.qpos[:], data.mocap_pos[:] = state.qpos, state.mocap_pos
        data.mocap_quat[:] = state.mocap_quat
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data

    def close(self) -> None:
        """Free the renderer; the next frame makes a new one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _renderer(model: mujoco.MjModel, size: tuple[int, int]) -> mujoco.Renderer:
    looks = model.vis.global_
    looks.offheight, looks.offwidth = max(looks.offheight, size[0]), max(looks.offwidth, size[1])
    try:
        return mujoco.Renderer(model, *size)
    except (mujoco.FatalError, ImportError, AttributeError, RuntimeError) as error:
        raise RuntimeError(_NO_OPENGL) from error


def _camera(model: mujoco.MjModel, camera: int | str | None) -> int | mujoco.MjvCamera:
    if isinstance(camera, int) and -1 <= camera < model.ncam:
        return camera
    name = "track" if camera is None else camera
    if isinstance(name, str):
        found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
        if found >= 0 or camera is None:
            return found if found >= 0 else _follower(model)
    known = [model.camera(i).name for i in range(model.ncam)]
    raise ValueError(f"there is no camera {camera!r}; the model has {known or 'none'}, and -1")


def _follower(model: mujoco.MjModel) -> mujoco.MjvCamera:
    """A camera in front of the first body, or of the origin if there is none."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera, body = mujoco.MjvCamera(), min(1, model.nbody - 1)
    reach = np.linalg.norm(data.geom_xpos - data.xpos[body], axis=1) + model.geom_rbound
    shown = reach[model.geom_bodyid > 0]
    camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, body
    camera.distance = 3 * max(shown, default=1.0)
    camera.azimuth, camera.elevation = 90, -15
    return camera
