"""Sensors that need positions only. Each returns (n, dim) readings of one group."""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.limits import joint_limit, tendon_limit
from jaxsim.sensor.readings import Readings, into_frame
from jaxsim.sensor.shapes import inside
from jaxsim.spatial import quat_conj, quat_mul, quat_normalize

_BODY = int(mujoco.mjtObj.mjOBJ_BODY)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


def jointpos(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Position of a slide joint (m) or hinge (rad)."""
    return take(r.motion.qpos, r.model.jnt_qposadr[g.obj])[:, None]


def ballquat(r: Readings, g: SensorGroup) -> Float[Array, "n 4"]:
    """Orientation of a ball joint, normalised."""
    start = r.model.jnt_qposadr[g.obj]
    return jax.vmap(quat_normalize)(jnp.stack([r.motion.qpos[i : i + 4] for i in start]))


def tendonpos(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Length of a tendon."""
    return take(r.signals.tendon_length, g.obj)[:, None]


def actuatorpos(r: Readings, g: SensorGroup) -> Float[Array, "n m"]:
    """Length of an actuator's transmission."""
    return r.of_actuators(r.signals.actuator_length, g.obj)


def jointlimitpos(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Distance from a joint's limit minus the margin; zero while the limit is inactive."""
    return joint_limit(r, g)[0][:, None]


def tendonlimitpos(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Distance from a tendon's limit minus the margin; zero while the limit is inactive."""
    return tendon_limit(r, g)[0][:, None]


def framepos(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Position of an object, in the world or in the frame of another object (m)."""
    pos, _ = r.frame(g.objtype, g.obj)
    if g.reftype < 0:
        return pos
    origin, mat = r.frame(g.reftype, g.ref)
    return into_frame(mat, pos - origin)


def framequat(r: Readings, g: SensorGroup) -> Float[Array, "n 4"]:
    """Orientation of an object, in the world or relative to another object."""
    quat = r.quat(g.objtype, g.obj)
    if g.reftype < 0:
        return quat
    return jax.vmap(lambda a, b: quat_mul(quat_conj(a), b))(r.quat(g.reftype, g.ref), quat)


def frameaxis(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """An axis of an object's frame, in the world or in the frame of another object."""
    column = ("FRAMEXAXIS", "FRAMEYAXIS", "FRAMEZAXIS").index(g.kind)
    axis = r.frame(g.objtype, g.obj)[1][:, :, column]
    if g.reftype < 0:
        return axis
    return into_frame(r.frame(g.reftype, g.ref)[1], axis)


def subtreecom(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Centre of mass of a body's subtree (m)."""
    return take(r.motion.kin.subtree_com, g.obj)


def magnetometer(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """The global magnetic field `model.opt.magnetic` in a site's frame."""
    field = jnp.broadcast_to(r.model.opt.magnetic[None], (len(g), 3))
    return into_frame(r.frame(_SITE, g.obj)[1], field)


def insidesite(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """1 if an object's position is inside a site's volume, else 0."""
    pos, _ = r.frame(g.objtype, g.obj)
    if g.objtype == _BODY:
        light = take(r.model.body_mass, g.obj) < MINVAL
        heavy_below = take(r.model.body_subtreemass, g.obj) >= MINVAL
        use_subtree = light & heavy_below & jnp.asarray(g.obj > 0)
        pos = jnp.where(use_subtree[:, None], take(r.motion.kin.subtree_com, g.obj), pos)
    origin, mat = r.frame(_SITE, g.ref)
    size = take(r.model.site_size, g.ref)
    within = jax.vmap(lambda s, p: inside(g.variant, s, p))(size, into_frame(mat, pos - origin))
    return within.astype(pos.dtype)[:, None]


def e_potential(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Potential energy (J)."""
    return jnp.broadcast_to(r.signals.energy[0][None, None], (len(g), 1))


def e_kinetic(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Kinetic energy (J)."""
    return jnp.broadcast_to(r.signals.energy[1][None, None], (len(g), 1))


def clock(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Simulation time (s)."""
    return jnp.broadcast_to(r.signals.time[None, None], (len(g), 1))
