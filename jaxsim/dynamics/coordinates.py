"""Moving in configuration space: `qpos` plus a velocity times a time, and its inverse."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.dynamics.joints import BALL, FREE, HINGE, NQ, integrate_joint, joint_difference
from jaxsim.dynamics.tree import take
from jaxsim.model import Model
from jaxsim.model.structure import JOINT_NDOF


def integrate_pos(
    model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"], dt: Float[Array, ""]
) -> Float[Array, "nq"]:
    """Coordinates after moving at constant velocity for `dt` seconds, as `mj_integratePos`."""
    return _per_joint(
        model,
        lambda kind, q, v: integrate_joint(kind, q, v, dt),
        [(qpos, _positions), (qvel, _velocities)],
        _positions,
    )


def difference_pos(
    model: Model, qpos1: Float[Array, "nq"], qpos2: Float[Array, "nq"], dt: Float[Array, ""] | float = 1.0
) -> Float[Array, "nv"]:
    """Velocity that leads from `qpos1` to `qpos2` in `dt` seconds, as `mj_differentiatePos`."""
    moved = _per_joint(
        model, joint_difference, [(qpos1, _positions), (qpos2, _positions)], _velocities
    )
    return moved / dt


def map_rotations(
    model: Model, f: Callable, *vectors: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """Replace the angular velocities of ball and free joints in the first vector by `f` of all.

    Args:
      model: the model.
      f: function of as many (3,) vectors as are given.
      vectors: vectors over the degrees of freedom.
    """

    def one(kind, *v):
        if kind == FREE:
            return jnp.concatenate([v[0][:3], f(*(x[3:] for x in v))])
        return f(*v) if kind == BALL else v[0]

    return _per_joint(model, one, [(v, _velocities) for v in vectors], _velocities)


def has_rotations(model: Model) -> bool:
    """Whether the model has ball or free joints."""
    return bool(np.isin(model.jnt_type, (BALL, FREE)).any())


def _per_joint(model: Model, f, inputs, layout) -> Float[Array, "..."]:
    """Concatenate `f(kind, ...)` of all joints; each input comes with the layout of its entries."""
    kinds = np.where(np.isin(model.jnt_type, (BALL, FREE)), model.jnt_type, HINGE)
    parts, places = [jnp.zeros(0, inputs[0][0].dtype)], [np.zeros(0, int)]
    for kind in np.unique(kinds):
        joints = np.nonzero(kinds == kind)[0]
        blocks = [_block(x, where(model, joints, int(kind))) for x, where in inputs]
        parts.append(jax.vmap(lambda *b, k=int(kind): f(k, *b))(*blocks).reshape(-1))
        places.append(layout(model, joints, int(kind)).reshape(-1))
    return take(jnp.concatenate(parts), np.argsort(np.concatenate(places)))


def _block(x, index):
    return take(x, index.reshape(-1)).reshape(index.shape)


def _positions(model: Model, joints, kind: int) -> np.ndarray:
    return model.jnt_qposadr[joints][:, None] + np.arange(NQ[kind])


def _velocities(model: Model, joints, kind: int) -> np.ndarray:
    return model.jnt_dofadr[joints][:, None] + np.arange(JOINT_NDOF[kind])
