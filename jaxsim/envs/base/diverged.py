"""`diverged`: the test for simulations that have diverged."""

import functools
import operator

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxsim.envs.base.env import EnvState

# MuJoCo's mjMAXVAL: beyond it a simulation counts as unstable, and float32 cannot square it twice.
LARGEST = 1e10


def diverged(after: EnvState) -> Bool[Array, ""]:
    """Whether a step has numbers that are not finite, or larger than `mjMAXVAL`.

    Tested are all floating-point numbers of the physics, the observation, the reward and the
    metrics.
    """
    seen = jax.tree.leaves((after.state, after.obs, after.reward, after.metrics))
    fine = [(jnp.abs(x) <= LARGEST).all() for x in seen if jnp.issubdtype(x.dtype, jnp.floating)]
    return ~functools.reduce(operator.and_, fine)
