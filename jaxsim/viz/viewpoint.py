"""Where a page is looked at from, so that all of a trajectory is in the picture."""

from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from jaxsim.viz.drawing import Drawing

# The camera looks along +y from a little above; its distance is so many radii of what moves, or of
# the space that it moves in. What goes farther than so many radii is let go.
AZIMUTH, ELEVATION, RADII, SPACE_RADII, FARTHEST = 90.0, -15.0, 4.0, 2.8, 4.0

Poses = Float[np.ndarray, "B T bodies 7"]  # positions and quaternions, scalar last


def viewpoint(
    source: mujoco.MjModel, poses: Poses, drawn: Drawing, stands: np.ndarray, follow: bool
) -> dict[str, Any]:
    """Target, distance, azimuth and elevation of the first look.

    Args:
      source: the model with its looks.
      poses: of the moving bodies.
      drawn: the drawing of the model.
      stands: (B, 3) where environments stand.
      follow: the camera goes along the ground with the first body.
    """
    middle, radius = _space(source, poses, drawn, follow)
    span = float(np.ptp(stands, axis=0).max())
    return {
        "target": (middle + stands.mean(0)).tolist(),
        "distance": max(RADII * drawn.extent, SPACE_RADII * radius) + 1.2 * span,
        "azimuth": AZIMUTH,
        "elevation": ELEVATION if len(stands) == 1 else 2 * ELEVATION,
    }


def _space(
    source: mujoco.MjModel, poses: Poses, drawn: Drawing, follow: bool
) -> tuple[np.ndarray, float]:
    """Middle and radius of the space that the geoms of all environments move in."""
    geoms = np.nonzero(np.isin(source.geom_bodyid, drawn.moving))[0]
    if not geoms.size:
        return drawn.center, 0.0
    slots = np.searchsorted(drawn.moving, source.geom_bodyid[geoms])
    pos = positions(poses[:, :, slots], source.geom_pos[geoms])
    if follow:
        pos[..., :2] -= (poses[:, :, :1] - poses[:, :1, :1])[..., :2]
    radius, far = source.geom_rbound[geoms, None], FARTHEST * drawn.extent
    low = np.maximum((pos - radius).min((0, 1, 2)), drawn.center - far)
    high = np.minimum((pos + radius).max((0, 1, 2)), drawn.center + far)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2)


def positions(poses: Float[np.ndarray, "... 7"], local: np.ndarray) -> np.ndarray:
    """(..., 3) where points of bodies are in the world.

    Rotation by a unit quaternion with vector v and scalar w: p + 2 v x (v x p + w p).
    """
    vector, w = poses[..., 3:6], poses[..., 6:]
    turned = local + 2 * np.cross(vector, np.cross(vector, local) + w * local)
    return poses[..., :3] + turned


def travel(poses: Float[np.ndarray, "T bodies 7"]) -> float:
    """How far the first body goes along the ground (m)."""
    path = poses[:, :1, :2].reshape(len(poses), -1)
    return float(np.ptp(path, axis=0).max(initial=0)) if path.size else 0.0
