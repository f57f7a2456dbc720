"""Sensors that need accelerations and forces. Each returns (n, dim) readings of one group."""

import jax
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings, into_frame
from jaxsim.spatial import wrench_from

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)


def accelerometer(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Linear acceleration of a site minus gravity, in its own frame (m/s^2)."""
    return into_frame(r.frame(_SITE, g.obj)[1], r.acceleration(_SITE, g.obj)[:, 3:])


def framelinacc(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Linear acceleration of an object minus gravity, world axes (m/s^2)."""
    return r.acceleration(g.objtype, g.obj)[:, 3:]


def frameangacc(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Angular acceleration of an object, world axes (rad/s^2)."""
    return r.acceleration(g.objtype, g.obj)[:, :3]


def force(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Force of the parent body on a site's body, in the site's frame (N)."""
    body = r.model.site_bodyid[g.obj]
    return into_frame(r.frame(_SITE, g.obj)[1], take(r.cfrc_int, body)[:, 3:])


def torque(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Torque of the parent body on a site's body about the site, in the site's frame (N m)."""
    body = r.model.site_bodyid[g.obj]
    pos, mat = r.frame(_SITE, g.obj)
    arm = take(r.motion.kin.subtree_com, r.model.body_rootid[body]) - pos
    return into_frame(mat, jax.vmap(wrench_from)(take(r.cfrc_int, body), arm)[:, :3])


def actuatorfrc(r: Readings, g: SensorGroup) -> Float[Array, "n m"]:
    """Force of an actuator."""
    return r.of_actuators(r.signals.actuator_force, g.obj)


def jointactfrc(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Force of all actuators on a joint (N or N m)."""
    return take(r.signals.qfrc_actuator, r.model.jnt_dofadr[g.obj])[:, None]


def tendonactfrc(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Sum of the scalar forces of the actuators that pull a tendon."""
    (pulling,) = np.nonzero(r.model.actuator_trntype == _TENDON)
    tendon = r.model.actuator_trnid[pulling, 0]
    total = sum_by(
        take(r.signals.actuator_force, r.model.actuator_outadr[pulling]), tendon, r.model.ntendon
    )
    return take(total, g.obj)[:, None]


def jointlimitfrc(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Force of a joint's limit, zero while it is inactive (N or N m)."""
    return take(r.signals.joint_limit_force, g.obj)[:, None]


def tendonlimitfrc(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Force of a tendon's limit, zero while it is inactive (N)."""
    return take(r.signals.tendon_limit_force, g.obj)[:, None]
