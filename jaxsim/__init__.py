"""Rigid-body simulation in JAX for robot learning and control.

Example:
  >>> import jax, jax.numpy as jnp, jaxsim
  >>> model = jaxsim.load("pendulum")
  >>> state = jaxsim.make_state(model)
  >>> final, trajectory = jax.jit(jaxsim.rollout)(model, state, jnp.zeros((100, model.nu)))
"""

import importlib

from jaxsim.batch import batch_rollout, configure_cpu, vmap
from jaxsim.check import check
from jaxsim.checkpoint import checkpoint
from jaxsim.dynamics.aba import forward_dynamics
from jaxsim.dynamics.crba import mass_matrix
from jaxsim.dynamics.rnea import inverse_dynamics
from jaxsim.io import load
from jaxsim.model import Model, ModelError, State, make_state
from jaxsim.step import Forward, forward, inverse, rollout, step

__version__ = "0.1.0"


def __getattr__(name: str):
    """Import `jaxsim.envs` and `jaxsim.rl` when they are first used."""
    if name in ("envs", "rl"):
        return importlib.import_module(f"jaxsim.{name}")
    raise AttributeError(f"module 'jaxsim' has no attribute {name!r}")


__all__ = [
    "Forward",
    "Model",
    "ModelError",
    "State",
    "batch_rollout",
    "check",
    "checkpoint",
    "configure_cpu",
    "forward",
    "forward_dynamics",
    "inverse",
    "inverse_dynamics",
    "load",
    "make_state",
    "mass_matrix",
    "rollout",
    "step",
    "vmap",
]
