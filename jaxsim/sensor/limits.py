"""Limits as sensors see them: which end is active, and how far it is violated."""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.joints.types import BALL
from jaxsim.model import Model
from jaxsim.sensor.groups import Group
from jaxsim.sensor.readings import Readings
from jaxsim.spatial import quat_log, quat_normalize

_LIMIT_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT
_CONSTRAINT_OFF = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def joint_limit(r: Readings, g: Group) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Distances from active joint limits less the margin, and their rates; zero if inactive."""
    model = r.model
    if _off(model):
        return jnp.zeros(len(g)), jnp.zeros(len(g))
    low, high = take(model.jnt_range, g.obj).T
    margin = take(model.jnt_margin, g.obj)
    at, start = model.jnt_qposadr[g.obj], model.jnt_dofadr[g.obj]
    if g.variant == BALL:
        q = jnp.stack([r.signals.qpos[i : i + 4] for i in at])
        v = jnp.stack([r.signals.qvel[i : i + 3] for i in start])
        angle, rate = jax.vmap(_turn)(q, v)
        result = jax.vmap(_upper)(angle, rate, jnp.maximum(low, high), margin)
    else:
        x, v = take(r.signals.qpos, at), take(r.signals.qvel, start)
        result = jax.vmap(_both)(x, v, low, high, margin)
    return _limited(model.jnt_limited[g.obj], result)


def tendon_limit(r: Readings, g: Group) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Distances from active tendon limits less the margin, and their rates; zero if inactive."""
    model = r.model
    if _off(model):
        return jnp.zeros(len(g)), jnp.zeros(len(g))
    low, high = take(model.tendon_range, g.obj).T
    x, v = (take(a, g.obj) for a in (r.signals.tendon_length, r.signals.tendon_velocity))
    result = jax.vmap(_both)(x, v, low, high, take(model.tendon_margin, g.obj))
    return _limited(model.tendon_limited[g.obj], result)


def _off(model: Model) -> bool:
    return model.opt.disabled(_LIMIT_OFF) or model.opt.disabled(_CONSTRAINT_OFF)


def _limited(limited, result):
    """Zero for what has no limit at all."""
    limited = jnp.asarray(limited, bool)
    pos, vel = result
    return jnp.where(limited, pos, 0), jnp.where(limited, vel, 0)


def _both(x, v, low, high, margin):
    """One coordinate between two ends; the lower one comes first if both are active."""
    pos, rate = _upper(x, v, high, margin)
    at_low = x - low < margin
    return jnp.where(at_low, x - low - margin, pos), jnp.where(at_low, v, rate)


def _upper(x, v, high, margin):
    active = high - x < margin
    return jnp.where(active, high - x - margin, 0), jnp.where(active, -v, 0)


def _turn(q, v):
    """Angle of a ball joint, and its rate: the velocity along the axis of the rotation."""
    w = quat_log(quat_normalize(q))
    square = w @ w
    still = square == 0
    angle = jnp.sqrt(jnp.where(still, 1, square))
    return jnp.where(still, 0, angle), jnp.where(still, 0, w @ v / angle)
