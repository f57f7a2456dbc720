"""Where a picture is taken from."""

import mujoco
import numpy as np

from jaxsim.viz.drawing import bounds

# Name or number of a camera of the model, -1 for a free one, a camera of one's own, or the usual.
Camera = int | str | mujoco.MjvCamera | None


def camera_of(model: mujoco.MjModel, camera: Camera, places: np.ndarray) -> mujoco.MjvCamera:
    """The camera that is meant.

    Where nothing is said, one environment is seen by its camera "track", or by one that follows
    its first body from a distance at which everything that moves is seen; several are seen from
    above a corner of their grid.

    Args:
      model: whose cameras have names.
      camera: what is asked for.
      places: (B, 3) where environments stand.

    Raises:
      ValueError: there is no such camera.
    """
    if isinstance(camera, mujoco.MjvCamera):
        return camera
    if camera is None:
        track = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, "track")
        if len(places) > 1:
            return _overview(model, places)
        return _fixed(track) if track >= 0 else _follower(model)
    found = camera
    if isinstance(camera, str):
        found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
    if isinstance(found, int) and 0 <= found < model.ncam:
        return _fixed(found)
    if camera == -1:
        return _overview(model, places) if len(places) > 1 else _free(model)
    known = [model.camera(i).name for i in range(model.ncam)]
    raise ValueError(f"there is no camera {camera!r}; the model has {known or 'none'}, and -1")


def _fixed(number: int) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, number
    return camera


def _free(model: mujoco.MjModel) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    return camera


def _follower(model: mujoco.MjModel) -> mujoco.MjvCamera:
    """A camera in front of the first body, or of the origin if there is none."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_TRACKING
    camera.trackbodyid, reach = min(1, model.nbody - 1), reach_of(model)
    camera.distance, camera.azimuth, camera.elevation = 3 * reach, 90, -15
    return camera


def reach_of(model: mujoco.MjModel) -> float:
    """Distance from the first body to the farthest point of any body (m)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    away = np.linalg.norm(data.geom_xpos - data.xpos[min(1, model.nbody - 1)], axis=1)
    return float(max((away + model.geom_rbound)[model.geom_bodyid > 0], default=1.0))


def _overview(model: mujoco.MjModel, places: np.ndarray) -> mujoco.MjvCamera:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    extent, center = bounds(model, data)
    camera = _free(model)
    camera.lookat[:] = center + places.mean(0)
    camera.distance = 2.5 * extent + 0.85 * float(np.ptp(places, axis=0).max())
    camera.azimuth, camera.elevation = 120, -25
    return camera
