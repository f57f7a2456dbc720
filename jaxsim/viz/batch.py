"""States of several environments and times as NumPy's arrays, and where environments stand."""

import math

import jax
import mujoco
import numpy as np

from jaxsim.model import State


def batched(source: mujoco.MjModel, trajectory: State, name: str) -> State:
    """States as NumPy's arrays with two leading axes, environments and time.

    Raises:
      ValueError: the states have another shape.
    """
    shape = np.shape(trajectory.qpos)
    if not 2 <= len(shape) <= 3 or shape[-1] != source.nq or not np.prod(shape[:-1]):
        raise ValueError(
            f"{name}.qpos must have shape (T, {source.nq}) or (B, T, {source.nq}), got {shape}; "
            "stack states along a leading axis of time, as jaxsim.rollout does"
        )
    states = jax.tree.map(np.asarray, trajectory)
    return states if len(shape) == 3 else jax.tree.map(lambda x: x[None], states)


def places(envs: int, extent: float) -> np.ndarray:
    """(B, 3) where environments stand: a square grid, 2.5 radii apart."""
    columns = math.ceil(math.sqrt(envs))
    grid = np.stack(np.divmod(np.arange(envs), columns)[::-1], axis=1) * 2.5 * extent
    return np.concatenate([grid, np.zeros((envs, 1))], axis=1)
