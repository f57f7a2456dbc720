"""Limits of joints and tendons."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.arrays.indexing import take
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.impedance import inverse_where, response
from jaxsim.constraint.jacobian import DenseRows, DofRows
from jaxsim.constraint.scene import Scene
from jaxsim.dynamics.tendon import tendon_jacobian, tendon_length
from jaxsim.dynamics.velocity import to_tree_order
from jaxsim.joints.types import BALL, HINGE, SLIDE
from jaxsim.solver import Unilateral
from jaxsim.spatial import quat_log

_LIMIT_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT


def limit_blocks(scene: Scene) -> list[Block]:
    """Rows of limited hinges and slides, of limited balls, and of limited tendons."""
    model = scene.model
    if model.opt.disabled(_LIMIT_OFF):
        return []
    limited = model.jnt_limited.astype(bool)
    (scalar,) = np.nonzero(limited & np.isin(model.jnt_type, (SLIDE, HINGE)))
    (ball,) = np.nonzero(limited & (model.jnt_type == BALL))
    (tendon,) = np.nonzero(model.tendon_limited)
    blocks = []
    if len(scalar):
        blocks.append(_scalar_joints(scene, scalar))
    if len(ball):
        blocks.append(_ball_joints(scene, ball))
    if len(tendon):
        blocks.append(_tendons(scene, tendon))
    return blocks


def _scalar_joints(scene: Scene, ids: np.ndarray) -> Block:
    """One row for both ends of a range: they are never active together."""
    model = scene.model
    violation, sign = _nearer_end(
        take(scene.qpos, model.jnt_qposadr[ids]),
        take(model.jnt_range, ids),
        take(model.jnt_margin, ids),
    )
    dofs = model.structure.dof_position[model.jnt_dofadr[ids]]
    rows = DofRows(sign, tuple(int(d) for d in dofs))
    return _joint_block(scene, ids, rows, violation)


def _ball_joints(scene: Scene, ids: np.ndarray) -> Block:
    """The angle of rotation is limited; its gradient is the axis, zero at the identity."""
    model = scene.model
    address = model.jnt_qposadr[ids][:, None] + np.arange(4)
    quat = take(scene.qpos, address.ravel()).reshape(-1, 4)

    def one(quat, bounds, margin):
        turn = quat_log(quat)
        square = jnp.sum(turn * turn)
        safe = jnp.sqrt(jnp.where(square > 0, square, 1.0))
        return jnp.max(bounds) - jnp.where(square > 0, safe, 0.0) - margin, -turn / safe

    violation, axis = jax.vmap(one)(quat, take(model.jnt_range, ids), take(model.jnt_margin, ids))
    J = jnp.zeros((len(ids), model.nv), axis.dtype)
    dofs = model.structure.dof_position[model.jnt_dofadr[ids][:, None] + np.arange(3)]
    J = J.at[np.arange(len(ids))[:, None], dofs].set(axis)
    return _joint_block(scene, ids, DenseRows(J), violation)


def _tendons(scene: Scene, ids: np.ndarray) -> Block:
    """Tendon lengths within their range."""
    model = scene.model
    length = take(tendon_length(model, scene.qpos), ids)
    violation, sign = _nearer_end(
        length, take(model.tendon_range, ids), take(model.tendon_margin, ids)
    )
    J = sign[:, None] * take(tendon_jacobian(model), ids)
    parameters = (
        take(model.tendon_solref_lim, ids),
        take(model.tendon_solimp_lim, ids),
        take(model.tendon_invweight0, ids),
    )
    rows = DenseRows(to_tree_order(model, J.T).T)
    return _block(scene, ids, rows, violation, parameters, RowType.LIMIT_TENDON)


def _nearer_end(value, bounds, margin):
    """Distance to the nearer end of each range, less the margin, and the sign of its gradient."""
    lower, upper = value - bounds[:, 0], bounds[:, 1] - value
    below = lower < upper
    one = jnp.ones_like(value)
    return jnp.where(below, lower, upper) - margin, jnp.where(below, one, -one)


def _joint_block(scene: Scene, ids: np.ndarray, jacobian, violation) -> Block:
    model = scene.model
    parameters = (
        take(model.jnt_solref, ids),
        take(model.jnt_solimp, ids),
        take(model.dof_invweight0, model.jnt_dofadr[ids]),
    )
    return _block(scene, ids, jacobian, violation, parameters, RowType.LIMIT_JOINT)


def _block(scene: Scene, ids, jacobian, violation, parameters, type_: RowType) -> Block:
    """Rows that are active where their violation is negative."""
    velocity = scene.velocity(jacobian)

    def row(violation, velocity, solref, solimp, weight):
        r = response(scene.model.opt, solref, solimp, violation)
        active = violation < 0
        aref = jnp.where(active, r.reference(velocity, violation), 0.0)
        return aref, inverse_where(active, r.regularisation(weight))

    aref, D = jax.vmap(row)(violation, velocity, *parameters)
    return Block(Unilateral(aref=aref, D=D), jacobian, type_, tuple(ids.tolist()))
