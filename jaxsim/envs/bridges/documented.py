"""Spaces of bundled tasks from their documentation, without starting JAX.

Gymnasium's `AsyncVectorEnv` makes one environment, reads its spaces, and then forks. If JAX had
been started before the fork, the new processes could not use it.
"""

import functools
from typing import Any, NamedTuple

import gymnasium
import jax
import mujoco
import numpy as np

from jaxsim.envs import registry
from jaxsim.envs.base.env import Env
from jaxsim.envs.registry.describe import describe
from jaxsim.io import bundled_models, bundled_xml

_BOUNDS = "action_size", "action_low", "action_high", "_action_bound"


class Known(NamedTuple):
    """Spaces of an environment, and the time between two actions (s)."""

    observation_space: gymnasium.spaces.Box
    action_space: gymnasium.spaces.Box
    dt: float


def documented(env: Env | str, options: dict[str, Any]) -> Known | None:
    """Spaces and dt from documentation and model; None if options or the class may change them."""
    if not isinstance(env, str) or options or env not in registry.names():
        return None
    cls = registry.spec(env).load()
    package, _, name = cls.__module__.rpartition(".")
    own = any(getattr(cls, bound) is not getattr(Env, bound) for bound in _BOUNDS)
    if package != "jaxsim.envs" or own or name not in bundled_models():
        return None
    return _known(cls, name, np.dtype(jax.dtypes.canonicalize_dtype(float)).type)


@functools.cache
def _known(cls: type[Env], name: str, dtype: type) -> Known:
    mj = mujoco.MjModel.from_xml_string(bundled_xml(name))
    limited = mj.actuator_ctrllimited.astype(bool)
    low = np.where(limited, mj.actuator_ctrlrange[:, 0], -np.inf).astype(np.float32)
    high = np.where(limited, mj.actuator_ctrlrange[:, 1], np.inf).astype(np.float32)
    size = describe(cls).sizes["observation"]
    return Known(
        gymnasium.spaces.Box(-np.inf, np.inf, (size,), dtype),
        gymnasium.spaces.Box(low, high, dtype=np.float32),
        float(mj.opt.timestep) * cls.frame_skip,
    )
