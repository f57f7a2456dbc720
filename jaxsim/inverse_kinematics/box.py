"""`Box`: which coordinates joints may have, and which may change."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from jaxsim.joints import JOINTS
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.joints.grouping import per_joint, position_rows, turning
from jaxsim.model import Model


@struct.dataclass
class Box:
    """Bounds of coordinates.

    Attributes:
      low: lower end of each degree of freedom that is a limited coordinate, otherwise -inf.
      high: upper end.
      adr: for each degree of freedom its place in `qpos`; static.
      moves: which degrees of freedom may change; static.
    """

    low: Float[Array, "nv"]
    high: Float[Array, "nv"]
    adr: np.ndarray = struct.field(pytree_node=False)
    moves: np.ndarray = struct.field(pytree_node=False)

    @classmethod
    def of(cls, model: Model, joints: Sequence[str] | None) -> "Box":
        """The limits of a model's joints, of which those in a list, or all, may move."""
        owner = model.dof_jntid
        scalar = np.array([JOINTS[int(t)].nq == 1 for t in model.jnt_type], bool)
        limited = (scalar & model.jnt_limited.astype(bool))[owner]
        ids = range(model.njnt) if joints is None else [model.names.id("joint", j) for j in joints]
        bounds = model.jnt_range[owner]
        return cls(
            low=jnp.where(limited, bounds[:, 0], -jnp.inf),
            high=jnp.where(limited, bounds[:, 1], jnp.inf),
            adr=np.where(scalar[owner], model.jnt_qposadr[owner], 0),
            moves=np.isin(owner, list(ids)),
        )

    def free(self, qpos: Float[Array, "nq"], gradient: Float[Array, "nv"]) -> Bool[Array, "nv"]:
        """Which degrees of freedom can follow the gradient downhill."""
        q = qpos[self.adr]
        blocked = ((q <= self.low) & (gradient > 0)) | ((q >= self.high) & (gradient < 0))
        return jnp.asarray(self.moves) & ~blocked

    def move(self, model: Model, qpos: Float[Array, "nq"], step: Float[Array, "nv"]):
        """`qpos` plus a step, brought back within the limits."""
        return clamped(model, integrate_pos(model, qpos, step, 1.0))

    def sample(self, model: Model, qpos: Float[Array, "nq"], count: Int[Array, ""]):
        """Coordinates spread over the limits, or over all angles without; the rest stays.

        Different ones for each count, by the additive recurrence of Roberts (2018), which fills a
        box more evenly than random numbers do.
        """
        turn = np.where(turning(model.jnt_type) & ~_in_world(model), np.pi, 0.0)
        bounded = jnp.isfinite(self.low)
        low = jnp.where(bounded, self.low - qpos[self.adr], -turn)
        high = jnp.where(bounded, self.high - qpos[self.adr], turn)
        fraction = (0.5 + count * jnp.asarray(_irrational(model.nv), low.dtype)) % 1.0
        step = jnp.where(self.moves, low + fraction * (high - low), 0.0)
        return self.move(model, qpos, step)


def _in_world(model: Model) -> np.ndarray:
    """(nv,) which degrees of freedom belong to joints that place their body in the world."""
    in_world = np.array([JOINTS[int(t)].in_world for t in model.jnt_type], bool)
    return in_world[model.dof_jntid]


def _irrational(n: int) -> np.ndarray:
    """(n,) `g^-1, ..., g^-n` with the root g of `g^(n + 1) = g + 1`."""
    g = 1.5
    for _ in range(50):
        g = (1 + g) ** (1 / (n + 1))
    return g ** -np.arange(1.0, n + 1)


def clamped(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, "nq"]:
    """The nearest coordinates within the limits of all joints."""
    limited = model.jnt_limited.astype(bool)[:, None]
    bounds = jnp.where(limited, model.jnt_range, jnp.array([[-jnp.inf, jnp.inf]], qpos.dtype))
    return per_joint(
        model.jnt_type,
        ("clamp",),
        lambda joint: joint.clamp,
        position_rows(model, qpos),
        bounds,
        empty=qpos,
        start=model.jnt_qposadr,
    )
