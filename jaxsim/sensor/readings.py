"""Quantities that several sensors share, computed when they are first used."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.kinds import Rows
from jaxsim.quantities import body_forces
from jaxsim.quantities.cameras import Frames, camera_frames
from jaxsim.quantities.momentum import subtree_velocities
from jaxsim.sensor.signals import Signals
from jaxsim.spatial import Inertia, acceleration_at, quat_mul, twist_at

_BODY = int(mujoco.mjtObj.mjOBJ_BODY)
_XBODY = int(mujoco.mjtObj.mjOBJ_XBODY)
_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
CAMERA = int(mujoco.mjtObj.mjOBJ_CAMERA)
# Names of position and orientation in `Kinematics`. A body's own frame is called "xbody".
_FRAMES = {
    _BODY: ("xipos", "ximat"),
    _XBODY: ("xpos", "xmat"),
    _GEOM: ("geom_xpos", "geom_xmat"),
    _SITE: ("site_xpos", "site_xmat"),
}


class Readings:
    """Signals and quantities derived from them, for one evaluation of the sensors."""

    def __init__(self, signals: Signals):
        self.motion, self.model = signals.motion, signals.motion.model
        # Untyped: `sensordata` has checked that the optional fields that are needed exist.
        self.signals: Any = signals

    @functools.cached_property
    def inertia(self) -> Inertia:
        """Inertias of all bodies about `tree_com`."""
        return body_forces.body_inertias(self.model, self.motion.kin)

    @functools.cached_property
    def cvel(self) -> Float[Array, "nbody 6"]:
        """Twists of all bodies about `tree_com`."""
        return body_forces.cvel(self.model, self.motion.kin, self.motion.vel)

    @functools.cached_property
    def cacc(self) -> Float[Array, "nbody 6"]:
        """Accelerations of all bodies about `tree_com`."""
        motion = self.motion
        return body_forces.cacc(self.model, motion.kin, motion.vel, self.signals.qacc)

    @functools.cached_property
    def cfrc_int(self) -> Float[Array, "nbody 6"]:
        """Wrenches from the parents about `tree_com`."""
        external = body_forces.cfrc_ext(self.model, self.motion.kin, self.signals.body_wrench)
        return body_forces.cfrc_int(self.model, self.inertia, self.cvel, self.cacc, external)

    @functools.cached_property
    def subtree_velocities(self) -> tuple[Float[Array, "nbody 3"], Float[Array, "nbody 3"]]:
        """Velocities of the subtrees' centres of mass, and angular momenta about them."""
        return subtree_velocities(self.model, self.motion.kin, self.motion.vel)

    @functools.cached_property
    def cameras(self) -> Frames:
        """Positions and orientations of all cameras."""
        return camera_frames(self.model, self.motion.kin)

    def frame(self, objtype: int, ids: np.ndarray) -> tuple[Array, Array]:
        """Positions (n, 3) and orientations (n, 3, 3) of objects of one kind."""
        if objtype == CAMERA:
            pos, mat = self.cameras
        else:
            pos, mat = (getattr(self.motion.kin, name) for name in _FRAMES[objtype])
        return take(pos, ids), take(mat, ids)

    def body(self, objtype: int, ids: np.ndarray) -> np.ndarray:
        """Bodies that carry objects of one kind."""
        model = self.model
        owners = {_GEOM: model.geom_bodyid, _SITE: model.site_bodyid, CAMERA: model.cam_bodyid}
        owner = owners.get(objtype)
        return ids if owner is None else owner[ids]

    def quat(self, objtype: int, ids: np.ndarray) -> Float[Array, "n 4"]:
        """Orientations of objects of one kind; the signs are MuJoCo's.

        As in MuJoCo, that of a camera is its mount's, whatever it looks at.
        """
        model = self.model
        base = take(self.motion.kin.xquat, self.body(objtype, ids))
        local = {_BODY: model.body_iquat, _GEOM: model.geom_quat, _SITE: model.site_quat}
        local[CAMERA] = model.cam_quat
        if objtype not in local:
            return base
        return jax.vmap(quat_mul)(base, take(local[objtype], ids))

    def of_actuators(self, signal: Float[Array, "nout"], ids: np.ndarray) -> Float[Array, "n m"]:
        """A quantity of actuators with m forces each."""
        model = self.model
        return Rows(signal, model.actuator_outadr, model.actuator_outnum).blocks(ids)

    def velocity(self, objtype: int, ids: np.ndarray) -> Float[Array, "n 6"]:
        """Twists of objects about their own positions, world axes."""
        body = self.body(objtype, ids)
        return jax.vmap(twist_at)(take(self.cvel, body), self._arm(objtype, ids, body))

    def acceleration(self, objtype: int, ids: np.ndarray) -> Float[Array, "n 6"]:
        """Angular and linear acceleration of objects minus gravity, world axes.

        As in MuJoCo, it is zero for objects that no joint moves: a sensor fixed to the world does
        not measure gravity.
        """
        body = self.body(objtype, ids)
        each = jax.vmap(acceleration_at)(
            take(self.cacc, body), take(self.cvel, body), self._arm(objtype, ids, body)
        )
        return jnp.where(self.model.body_link[body][:, None] >= 0, each, 0)

    def _arm(self, objtype: int, ids: np.ndarray, body: np.ndarray) -> Float[Array, "n 3"]:
        """Positions of objects relative to `tree_com` of their bodies."""
        com = take(self.motion.kin.subtree_com, self.model.body_rootid[body])
        return self.frame(objtype, ids)[0] - com


def into_frame(mat: Float[Array, "n 3 3"], v: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Components of world vectors in the axes of frames: `R^T v`."""
    return jax.vmap(lambda R, v: R.T @ v)(mat, v)
