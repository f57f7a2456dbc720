"""Contact points and forces of trajectories, ready to draw."""

import dataclasses
import functools

import jax
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.engine import forward
from jaxsim.model import Model, State
from jaxsim.viz.models import physics_of


@dataclasses.dataclass(frozen=True)
class Touch:
    """Contacts of one environment at several times.

    Attributes:
      first: (T + 1,) rows `first[t]` to `first[t + 1]` are those of time t.
      rows: (n, 6) points and forces on the second geom of each contact, world axes (m, N).
    """

    first: np.ndarray
    rows: np.ndarray

    def at(self, time: int) -> np.ndarray:
        """The rows of one time."""
        return self.rows[self.first[time] : self.first[time + 1]]

    def totals(self) -> np.ndarray:
        """(T,) sizes of all forces of a time together (N)."""
        owner = np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))
        size = np.linalg.norm(self.rows[:, 3:], axis=1)
        return np.bincount(owner, size, minlength=len(self.first) - 1)


def touches(
    model: Model | mujoco.MjModel,
    batch: State,
    ctrls: Float[Array, "*batch T nu"] | None,
    kept: np.ndarray,
) -> list[Touch]:
    """Contacts of each environment, as `jaxsim.forward` has them.

    Args:
      model: of one environment.
      batch: states (B, T, ...).
      ctrls: controls (T, nu) or (B, T, nu); zeros if None.
      kept: (n,) which times.

    Raises:
      ValueError: the controls have another shape.
    """
    model = physics_of(model)
    shape = (*batch.qpos.shape[:2], model.nu)
    given = np.zeros(shape) if ctrls is None else np.asarray(ctrls)
    given = given[None] if given.ndim == 2 else given
    if given.shape != shape:
        raise ValueError(f"ctrls must have shape {shape} or {shape[1:]}, got {given.shape}")
    at = jax.jit(functools.partial(jax.lax.map, lambda x: forward(model, *x).contact))
    found = []
    for env in range(shape[0]):
        states = jax.tree.map(lambda x, env=env: x[env, kept], batch)
        ctrl = given[env, kept].astype(batch.qpos.dtype)
        report = jax.tree.map(np.asarray, at((states, ctrl)))
        force = np.einsum("tcij,tci->tcj", report.frame, report.force[..., :3])
        rows = np.concatenate([report.pos, force], axis=-1)[report.active]
        first = np.concatenate([[0], np.cumsum(report.active.sum(1))])
        found.append(Touch(first, rows))
    return found


def metres_per_newton(found: list[Touch], extent: float) -> float:
    """Length of an arrow for each newton: the median force is 0.4 radii long.

    Impacts are many times larger than what carries a body; whoever draws cuts their arrows short.
    """
    size = np.concatenate([np.zeros(0), *(np.linalg.norm(t.rows[:, 3:], axis=1) for t in found)])
    pushing = size[size > 0]
    return float(0.4 * extent / np.median(pushing)) if pushing.size else 0.0
