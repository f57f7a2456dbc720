"""Sensors whose readings a callback would compute."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings


def user(r: Readings, g: SensorGroup) -> Float[Array, "n dim"]:
    """Zeros, as in MuJoCo without a callback."""
    return jnp.zeros((len(g), g.variant), r.motion.qpos.dtype)
