"""Rigid-body simulation in JAX for robot learning and control.

Example:
  >>> import jax, jax.numpy as jnp, jaxsim
  >>> model = jaxsim.load("pendulum")
  >>> state = jaxsim.make_state(model)
  >>> final, trajectory = jax.jit(jaxsim.rollout)(model, state, jnp.zeros((100, model.nu)))
"""

import importlib

from jaxsim import model
from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.batching import vmap
from jaxsim.dynamics.aba import forward_dynamics
from jaxsim.dynamics.crba import mass_matrix
from jaxsim.dynamics.rnea import inverse_dynamics
from jaxsim.engine import (
    ContactReport,
    Forward,
    ForwardDetails,
    SimulationError,
    Status,
    check,
    forward,
    forward_details,
    inverse,
    rollout,
    step,
    step_with_status,
    substeps,
)
from jaxsim.inverse_kinematics import IkResult, PoseTarget, ik
from jaxsim.io import load, set_const, to_mujoco
from jaxsim.maximal import Maximal, MaximalState, to_maximal
from jaxsim.model import JaxsimError, Model, ModelError, Option, State, make_state
from jaxsim.parallel import batch_rollout, configure_cpu
from jaxsim.quantities.distance import GeomDistance, geom_distance
from jaxsim.quantities.rays import RayHit, ray

__version__ = "0.1.0"
model.set_const = set_const  # the name of `jaxsim.set_const` in earlier versions


def __getattr__(name: str):
    """Import the packages above the engine when they are first used."""
    if name in ("envs", "gradients", "rl", "sysid", "trajopt", "viz"):
        return importlib.import_module(f"jaxsim.{name}")
    raise AttributeError(f"module 'jaxsim' has no attribute {name!r}")


__all__ = [
    "ContactReport",
    "Forward",
    "ForwardDetails",
    "GeomDistance",
    "IkResult",
    "JaxsimError",
    "Maximal",
    "MaximalState",
    "Model",
    "ModelError",
    "Option",
    "PoseTarget",
    "RayHit",
    "SimulationError",
    "State",
    "Status",
    "batch_rollout",
    "check",
    "checkpoint",
    "configure_cpu",
    "forward",
    "forward_details",
    "forward_dynamics",
    "geom_distance",
    "ik",
    "inverse",
    "inverse_dynamics",
    "load",
    "make_state",
    "mass_matrix",
    "ray",
    "rollout",
    "set_const",
    "step",
    "step_with_status",
    "substeps",
    "to_maximal",
    "to_mujoco",
    "vmap",
]
