"""Frames that MuJoCo treats as equal to the frame of their body.

MuJoCo's compiler marks inertial frames, geoms and sites whose pose equals that of the body (or of
its inertial frame) up to rounding. Its engine then ignores the numbers in their pose. Here those
numbers are replaced by the pose that the engine uses.
"""

import mujoco
import numpy as np

_SAME = mujoco.mjtSameFrame
_BODY = int(_SAME.mjSAMEFRAME_BODY)
_BODYROT = int(_SAME.mjSAMEFRAME_BODYROT)
_INERTIA = int(_SAME.mjSAMEFRAME_INERTIA)
_INERTIAROT = int(_SAME.mjSAMEFRAME_INERTIAROT)


def effective_frames(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Poses of inertial frames, geoms and sites as the engine uses them, by field name."""
    inertial = _aligned(mj.body_ipos, mj.body_iquat, mj.body_sameframe, None, None)
    frames = {"body_ipos": inertial[0], "body_iquat": inertial[1]}
    for kind in ("geom", "site"):
        body = getattr(mj, f"{kind}_bodyid")
        frames[f"{kind}_pos"], frames[f"{kind}_quat"] = _aligned(
            getattr(mj, f"{kind}_pos"),
            getattr(mj, f"{kind}_quat"),
            getattr(mj, f"{kind}_sameframe"),
            inertial[0][body],
            inertial[1][body],
        )
    return frames


def _aligned(pos, quat, same, inertial_pos, inertial_quat):
    pos, quat, same = np.array(pos), np.array(quat), np.asarray(same)
    pos[same == _BODY] = 0
    quat[(same == _BODY) | (same == _BODYROT)] = (1, 0, 0, 0)
    if inertial_pos is not None:
        whole, turned = same == _INERTIA, (same == _INERTIA) | (same == _INERTIAROT)
        pos[whole] = inertial_pos[whole]
        quat[turned] = inertial_quat[turned]
    return pos, quat
