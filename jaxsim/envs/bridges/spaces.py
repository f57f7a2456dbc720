"""Gymnasium's view of an environment: its spaces, and its metrics as an `info` dictionary."""

from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.envs.base.env import Env, EnvState


def observation_space(env: Env) -> gymnasium.spaces.Box:
    """The unbounded box of the observation's size, in the type of the observations."""
    shape = jax.eval_shape(env.reset, jax.eval_shape(lambda: jax.random.key(0))).obs
    return gymnasium.spaces.Box(-np.inf, np.inf, shape.shape, np.dtype(shape.dtype).type)


def action_space(env: Env) -> gymnasium.spaces.Box:
    """The box of the controls' ranges; always float32, as learners expect."""
    low, high = (np.asarray(x, np.float32) for x in (env.action_low, env.action_high))
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def public_info(state: EnvState) -> dict[str, Any]:
    """The numbers for users: metrics and the task's own entries of `info`."""
    kept = {k: v for k, v in state.info.items() if not is_private(k, v)}
    return {**kept, **state.metrics}


def is_private(name: str, value: Any) -> bool:
    """Whether an entry is private to wrappers: underscored names, random keys, nested records."""
    if name.startswith("_") or not hasattr(value, "dtype"):
        return True
    return jnp.issubdtype(value.dtype, jax.dtypes.prng_key)


def vector_info(info: dict[str, Any], mask: np.ndarray) -> dict[str, Any]:
    """Gymnasium's vector format: for each `key` a mask `_key`; values are zero outside of it."""
    out: dict[str, Any] = {}
    for name, value in info.items():
        if isinstance(value, np.ndarray) and value.dtype != object:
            value = np.array(value)
            value[~mask] = 0
        out[name], out[f"_{name}"] = value, mask.copy()
    return out
