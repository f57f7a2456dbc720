"""Distances from active limits of joints and tendons, and their rates, for sensors."""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.joints import JOINTS
from jaxsim.joints.grouping import position_rows, velocity_rows
from jaxsim.model import Model
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings

_LIMIT_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT
_CONSTRAINT_OFF = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def joint_limit(r: Readings, g: SensorGroup) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Distances from active joint limits minus the margin, and their rates; zero if inactive."""
    model = r.model
    if _off(model):
        return jnp.zeros(len(g)), jnp.zeros(len(g))
    joint = JOINTS[g.variant]
    q = position_rows(model, r.motion.qpos, g.obj).blocks()
    v = velocity_rows(model, r.motion.qvel, g.obj).blocks()
    lower, upper, gradient = jax.vmap(joint.limit)(q, take(model.jnt_range, g.obj))
    rate = jnp.sum(gradient * v, axis=1)
    result = jax.vmap(_nearer_end)(lower, upper, rate, take(model.jnt_margin, g.obj))
    return _limited(model.jnt_limited[g.obj], result)


def tendon_limit(r: Readings, g: SensorGroup) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Distances from active tendon limits minus the margin, and their rates; zero if inactive."""
    model = r.model
    if _off(model):
        return jnp.zeros(len(g)), jnp.zeros(len(g))
    low, high = take(model.tendon_range, g.obj).T
    x, v = (take(a, g.obj) for a in (r.signals.tendon_length, r.signals.tendon_velocity))
    result = jax.vmap(_nearer_end)(x - low, high - x, v, take(model.tendon_margin, g.obj))
    return _limited(model.tendon_limited[g.obj], result)


def _off(model: Model) -> bool:
    return model.opt.disabled(_LIMIT_OFF) or model.opt.disabled(_CONSTRAINT_OFF)


def _limited(limited, result):
    """Distances and rates, zero for joints or tendons without limits."""
    limited = jnp.asarray(limited, bool)
    pos, vel = result
    return jnp.where(limited, pos, 0), jnp.where(limited, vel, 0)


def _nearer_end(lower, upper, rate, margin):
    """Distance from the active end minus the margin, and its rate; the lower end if both are."""
    at_low, at_high = lower < margin, upper < margin
    pos, vel = jnp.where(at_high, upper - margin, 0), jnp.where(at_high, -rate, 0)
    return jnp.where(at_low, lower - margin, pos), jnp.where(at_low, rate, vel)
