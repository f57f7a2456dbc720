"""Sensors that need velocities. Each returns (n, dim) readings of one group."""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.limits import joint_limit, tendon_limit
from jaxsim.sensor.readings import Readings, into_frame
from jaxsim.spatial import twist_at

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


def velocimeter(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Linear velocity of a site in its own frame (m/s)."""
    return into_frame(r.frame(_SITE, g.obj)[1], r.velocity(_SITE, g.obj)[:, 3:])


def gyro(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Angular velocity of a site in its own frame (rad/s)."""
    return into_frame(r.frame(_SITE, g.obj)[1], r.velocity(_SITE, g.obj)[:, :3])


def jointvel(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Velocity of a slide joint (m/s) or hinge (rad/s)."""
    return take(r.motion.qvel, r.model.jnt_dofadr[g.obj])[:, None]


def ballangvel(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Angular velocity of a ball joint in the axes of its body (rad/s)."""
    return jnp.stack([r.motion.qvel[i : i + 3] for i in r.model.jnt_dofadr[g.obj]])


def tendonvel(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Rate of a tendon's length."""
    return take(r.signals.tendon_velocity, g.obj)[:, None]


def actuatorvel(r: Readings, g: SensorGroup) -> Float[Array, "n m"]:
    """Rate of the length of an actuator's transmission."""
    return r.of_actuators(r.signals.actuator_velocity, g.obj)


def jointlimitvel(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Rate of the distance from a joint's limit, zero while the limit is inactive."""
    return joint_limit(r, g)[1][:, None]


def tendonlimitvel(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Rate of the distance from a tendon's limit, zero while the limit is inactive."""
    return tendon_limit(r, g)[1][:, None]


def framelinvel(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Velocity of an object's position, in the world or as seen from a moving frame (m/s)."""
    linear = r.velocity(g.objtype, g.obj)[:, 3:]
    if g.reftype < 0:
        return linear
    pos, _ = r.frame(g.objtype, g.obj)
    origin, mat = r.frame(g.reftype, g.ref)
    carried = jax.vmap(twist_at)(r.velocity(g.reftype, g.ref), pos - origin)
    return into_frame(mat, linear - carried[:, 3:])


def frameangvel(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Angular velocity of an object, in the world or relative to a moving frame (rad/s)."""
    angular = r.velocity(g.objtype, g.obj)[:, :3]
    if g.reftype < 0:
        return angular
    mat = r.frame(g.reftype, g.ref)[1]
    return into_frame(mat, angular - r.velocity(g.reftype, g.ref)[:, :3])


def subtreelinvel(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Velocity of the centre of mass of a body's subtree (m/s)."""
    return take(r.subtree_velocities[0], g.obj)


def subtreeangmom(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Angular momentum of a body's subtree about its centre of mass (N m s)."""
    return take(r.subtree_velocities[1], g.obj)
