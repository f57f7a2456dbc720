"""The mouse as a spring between a point of a body and the pointer."""

import dataclasses

import mujoco
import numpy as np

_STIFFNESS = 40.0  # 1/s^2, times the mass of all that the body is joined to
_DAMPING = 6.0  # 1/s, the same


@dataclasses.dataclass(frozen=True)
class Pull:
    """A body, the point where it is held, and where it is drawn to, in the world (m)."""

    body: int
    point: np.ndarray
    target: np.ndarray

    def wrench(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """(6,) force and torque about the body's centre of mass, as `xfrc_applied` has them.

        The spring's force is k m (target - point) - d m v, with m the mass of the whole tree and v
        the velocity of the body's centre of mass.

        Args:
          model: of which the body is one.
          data: with poses and velocities of the bodies.
        """
        mass = model.body_subtreemass[model.body_rootid[self.body]]
        motion = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, self.body, motion, 0)
        spring = _STIFFNESS * (self.target - self.point) - _DAMPING * motion[3:]
        force = mass * spring
        return np.concatenate([force, np.cross(self.point - data.xipos[self.body], force)])
