"""Packing of a step's results in one array for each type, because each result costs time."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxsim.envs.base.env import EnvState
from jaxsim.envs.bridges.spaces import public_info


class Layout:
    """Positions of a step's results in the packed arrays; known once `packed` has been traced."""

    def __init__(self):
        self._places: list[tuple[str, str, int, tuple[int, ...], np.dtype]] = []

    def packed(self, state: EnvState) -> dict[str, Array]:
        """Observation, reward, both ends and the public infos, in one vector for each type."""
        told = {
            "obs": state.obs,
            "reward": state.reward,
            "terminated": state.terminated,
            "truncated": state.truncated,
            **{f"info {name}": value for name, value in public_info(state).items()},
        }
        vectors: dict[str, list[Array]] = {}
        self._places = []
        for name, value in told.items():
            kind = "int32" if value.dtype == jnp.bool_ else value.dtype.name
            parts = vectors.setdefault(kind, [])
            start = sum(part.size for part in parts)
            self._places.append((name, kind, start, value.shape, np.dtype(value.dtype)))
            parts.append(value.reshape(-1).astype(kind))
        return {kind: jnp.concatenate(parts) for kind, parts in vectors.items()}

    def unpacked(self, packed: dict[str, Array]) -> tuple[np.ndarray, float, bool, bool, dict]:
        """The results as NumPy arrays and Python numbers."""
        arrays = {kind: np.asarray(vector) for kind, vector in packed.items()}
        told: dict[str, Any] = {}
        for name, kind, start, shape, dtype in self._places:
            if shape:
                part = arrays[kind][start : start + math.prod(shape)]
                told[name] = part.reshape(shape).astype(dtype)
            else:
                told[name] = dtype.type(arrays[kind][start]).item()
        ends = told.pop("terminated"), told.pop("truncated")
        obs, reward = told.pop("obs"), told.pop("reward")
        return obs, reward, *ends, {name.removeprefix("info "): v for name, v in told.items()}
