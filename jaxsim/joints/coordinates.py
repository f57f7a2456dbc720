"""Moving in configuration space: `qpos` plus a velocity times a time, and its inverse."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.series import cotangent_defect
from jaxsim.joints.types import BALL, FREE, HINGE, NQ, integrate_joint, joint_difference
from jaxsim.model import Model
from jaxsim.model.structure import JOINT_NDOF


def integrate_pos(
    model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"], dt: Float[Array, ""] | float
) -> Float[Array, "nq"]:
    """Coordinates after moving at constant velocity for `dt` seconds, as `mj_integratePos`."""
    return _per_joint(
        model,
        lambda kind, q, v: integrate_joint(kind, q, v, dt),
        [(qpos, _positions), (qvel, _velocities)],
        _positions,
    )


def difference_pos(
    model: Model,
    qpos1: Float[Array, "nq"],
    qpos2: Float[Array, "nq"],
    dt: Float[Array, ""] | float = 1.0,
) -> Float[Array, "nv"]:
    """Velocity that leads from `qpos1` to `qpos2` in `dt` seconds, as `mj_differentiatePos`."""
    moved = _per_joint(
        model, joint_difference, [(qpos1, _positions), (qpos2, _positions)], _velocities
    )
    return moved / dt


def exponential_rate(
    model: Model, qvel: Float[Array, "nv"], theta: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """Rate of the exponential coordinates theta, measured from some `qpos`, that a velocity means.

    For rotations it is `w + theta x w / 2 + c theta x (theta x w)`, the inverse of the right
    Jacobian of the exponential map, for w in the moving axes; elsewhere the velocity itself.

    Args:
      model: the model.
      qvel: velocities at `integrate_pos(model, qpos, theta, 1)`.
      theta: the exponential coordinates.
    """

    def rotation(w, x):
        turned = jnp.cross(x, w)
        return w + turned / 2 + cotangent_defect(x @ x) * jnp.cross(x, turned)

    def one(kind, w, x):
        if kind == FREE:
            return jnp.concatenate([w[:3], rotation(w[3:], x[3:])])
        return rotation(w, x) if kind == BALL else w

    return _per_joint(model, one, [(qvel, _velocities), (theta, _velocities)], _velocities)


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
