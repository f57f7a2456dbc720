"""The one rule about numbers that are not numbers any more."""

import functools
import operator

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxsim.envs.base.env import EnvState

# MuJoCo's mjMAXVAL: beyond it a simulation counts as unstable, and float32 cannot square it twice.
LARGEST = 1e10


def diverged(after: EnvState) -> Bool[Array, ""]:
    """Whether a step ended in numbers that are not finite, or too large to be meant.

    Looked at are the physics, the observation, the reward and the metrics, all of floating point.
    """
    seen = jax.tree.leaves((after.state, after.obs, after.reward, after.metrics))
    fine = [(jnp.abs(x) <= LARGEST).all() for x in seen if jnp.issubdtype(x.dtype, jnp.floating)]
    return ~functools.reduce(operator.and_, fine)
