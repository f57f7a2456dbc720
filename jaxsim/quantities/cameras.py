"""Poses and projections of cameras, which sensors read."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.model import Model
from jaxsim.spatial import quat_normalize, quat_to_matrix

_Mode = mujoco.mjtCamLight
_TRACK, _TRACKCOM = int(_Mode.mjCAMLIGHT_TRACK), int(_Mode.mjCAMLIGHT_TRACKCOM)
_TARGET, _TARGETCOM = int(_Mode.mjCAMLIGHT_TARGETBODY), int(_Mode.mjCAMLIGHT_TARGETBODYCOM)
_ORTHOGRAPHIC = int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)

Frames = tuple[Float[Array, "ncam 3"], Float[Array, "ncam 3 3"]]


def camera_frames(model: Model, kin: Kinematics) -> Frames:
    """Positions (m) and axes of all cameras; they look along their negative z axes.

    Cameras follow bodies or look at them as their `mode` says; see MuJoCo's `mj_camlight`.
    """
    pos, mat = mounted_frames(model, kin)
    mode, body = model.cam_mode, model.cam_bodyid
    for kind, carrier, offset in (
        (_TRACK, kin.xpos, model.cam_pos0),
        (_TRACKCOM, kin.subtree_com, model.cam_poscom0),
    ):
        chosen = jnp.asarray(mode == kind)
        if (mode == kind).any():
            pos = jnp.where(chosen[:, None], take(carrier, body) + offset, pos)
            mat = jnp.where(chosen[:, None, None], model.cam_mat0.reshape(-1, 3, 3), mat)
    for kind, targets in ((_TARGET, kin.xpos), (_TARGETCOM, kin.subtree_com)):
        aimed = (mode == kind) & (model.cam_targetbodyid >= 0)
        if aimed.any():
            target = take(targets, np.maximum(model.cam_targetbodyid, 0))
            mat = jnp.where(jnp.asarray(aimed)[:, None, None], jax.vmap(_aim)(pos, target), mat)
    return pos, mat


def mounted_frames(model: Model, kin: Kinematics) -> Frames:
    """Positions and axes of cameras as if all were fixed to their bodies."""

    def one(xpos, xmat, pos, quat):
        return xpos + xmat @ pos, xmat @ quat_to_matrix(quat_normalize(quat))

    body = model.cam_bodyid
    return jax.vmap(one)(take(kin.xpos, body), take(kin.xmat, body), model.cam_pos, model.cam_quat)


def _aim(pos: Float[Array, "3"], target: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Axes of a camera that looks at a point, with a horizontal x axis."""
    z = _unit(pos - target)
    x = _unit(jnp.stack([-z[1], z[0], jnp.zeros_like(z[0])]))
    return jnp.stack([x, _unit(jnp.cross(z, x)), z], axis=1)


def _unit(v: Float[Array, "3"]) -> Float[Array, "3"]:
    """A unit vector; as in MuJoCo, the x axis if the length is zero."""
    norm, divisor = norm_and_divisor(v)
    return jnp.where(norm < MINVAL, jnp.zeros_like(v).at[0].set(1), v / divisor)


def focal_lengths(model: Model, cameras: np.ndarray) -> Float[Array, "n 2"]:
    """Focal lengths in pixels along the image's axes, from the sensor's size if it is given.

    Otherwise from `fovy`, the vertical field of view in degrees.
    """
    height = jnp.asarray(model.cam_resolution[cameras, 1], model.cam_fovy.dtype)[:, None]
    opened = 0.5 * height / jnp.tan(jnp.deg2rad(take(model.cam_fovy, cameras))[:, None] / 2)
    calibrated, pixels = _pixels_per_length(model, cameras)
    return jnp.where(calibrated, take(model.cam_intrinsic, cameras)[:, :2] * pixels, opened)


def _pixels_per_length(model: Model, cameras: np.ndarray):
    """Whether a sensor's size is given, and its pixels per metre along the image's axes."""
    size = take(model.cam_sensorsize, cameras)
    calibrated = (size != 0).all(axis=1, keepdims=True)
    return calibrated, image_size(model, cameras) / jnp.where(calibrated, size, 1)


def image_size(model: Model, cameras: np.ndarray) -> Float[Array, "n 2"]:
    """Width and height in pixels."""
    return jnp.asarray(model.cam_resolution[cameras], model.cam_fovy.dtype)


def pixel_rays(
    model: Model, camera: int, pos: Float[Array, "3"], mat: Float[Array, "3 3"]
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Starts and unit directions of the rays through the centres of all pixels, row by row."""
    width, height = model.cam_resolution[camera]
    row, column = np.divmod(np.arange(width * height), width)
    pixel = jnp.asarray(np.stack([column + 0.5, row + 0.5], axis=1), pos.dtype)
    ids, axes = np.array([camera]), mat[:, :2] * jnp.asarray([[1.0, -1.0]], pos.dtype)
    middle = image_size(model, ids) / 2
    if model.cam_projection[camera] == _ORTHOGRAPHIC:
        plane = 0.5 * model.cam_fovy[camera] * (pixel / middle - 1)
        return pos[None] + plane @ axes.T, jnp.broadcast_to(-mat[None, :, 2], (len(pixel), 3))
    calibrated, scale = _pixels_per_length(model, ids)
    center = jnp.where(calibrated, take(model.cam_intrinsic, ids)[:, 2:] * scale, middle)
    toward = ((pixel - center) / focal_lengths(model, ids)) @ axes.T - mat[None, :, 2]
    toward = toward / jnp.linalg.norm(toward, axis=1, keepdims=True)
    return jnp.broadcast_to(pos[None], toward.shape), toward
