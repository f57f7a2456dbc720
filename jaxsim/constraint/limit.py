"""Limits of joints and tendons."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array

from jaxsim.arrays.indexing import take
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.entry import entry
from jaxsim.constraint.impedance import inverse_where, response
from jaxsim.constraint.jacobian import DenseRows, DofRows, moves_anything, row_velocity
from jaxsim.constraint.row_inertia import row_inertia
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.tendons.tendon import tendon_jacobian
from jaxsim.joints import JOINTS
from jaxsim.joints.grouping import position_rows, shared_type
from jaxsim.model import Model
from jaxsim.model.dof_order import to_tree_order
from jaxsim.solver import Unilateral

_LIMIT_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT


def limit_blocks(motion: Motion) -> list[Block]:
    """Rows of limited joints, one block for each kind of limit, and of limited tendons."""
    model = motion.model
    if model.opt.disabled(_LIMIT_OFF):
        return []
    (joints,) = np.nonzero(model.jnt_limited)
    (tendon,) = np.nonzero(model.tendon_limited)
    kinds = shared_type(model.jnt_type[joints], "limit")
    blocks = [_joints(motion, joints[kinds == k]) for k in np.unique(kinds)]
    if len(tendon):
        blocks.append(_tendons(motion, tendon))
    return blocks


def _joints(motion: Motion, ids: np.ndarray) -> Block:
    """Rows of joints of one kind, one for both ends of a range: only one can be active."""
    model, joint = motion.model, JOINTS[int(motion.model.jnt_type[ids[0]])]
    lower, upper, gradient = jax.vmap(joint.limit)(
        position_rows(model, motion.qpos, ids).blocks(), take(model.jnt_range, ids)
    )
    violation, gradient = _nearer_end(lower, upper, gradient, take(model.jnt_margin, ids))
    dofs = model.structure.dof_position[model.jnt_dofadr[ids][:, None] + np.arange(joint.nv)]
    return _joint_block(motion, ids, _rows(model, gradient, dofs), violation)


def _rows(model: Model, gradient, dofs: np.ndarray):
    """Rows with these derivatives (n, k) with respect to degrees of freedom (n, k)."""
    n, nv = dofs.shape
    if nv == 1:
        return DofRows(gradient[:, 0], tuple(dofs[:, 0].tolist()))
    J = jnp.zeros((n, model.nv), gradient.dtype)
    return DenseRows(J.at[np.arange(n)[:, None], dofs].set(gradient))


def _tendons(motion: Motion, ids: np.ndarray) -> Block:
    """Rows of limited tendons."""
    model = motion.model
    length, bounds = take(motion.kin.ten_length, ids), take(model.tendon_range, ids)
    violation, J = _nearer_end(
        length - bounds[:, 0],
        bounds[:, 1] - length,
        take(tendon_jacobian(model, motion.kin), ids),
        take(model.tendon_margin, ids),
    )
    parameters = (
        take(model.tendon_solref_lim, ids),
        take(model.tendon_solimp_lim, ids),
        take(model.tendon_invweight0, ids),
    )
    rows = DenseRows(to_tree_order(model, J.T).T)
    return _block(motion, ids, rows, violation, parameters, RowType.LIMIT_TENDON, moves_anything(J))


def _nearer_end(lower, upper, gradient, margin):
    """Distance to the nearer end of each range minus the margin, and its gradient."""
    below = lower < upper
    return (
        jnp.where(below, lower, upper) - margin,
        jnp.where(below[:, None], gradient, -gradient),
    )


def _joint_block(motion: Motion, ids: np.ndarray, jacobian, violation) -> Block:
    model = motion.model
    parameters = (
        take(model.jnt_solref, ids),
        take(model.jnt_solimp, ids),
        take(model.dof_invweight0, model.jnt_dofadr[ids]),
    )
    return _block(motion, ids, jacobian, violation, parameters, RowType.LIMIT_JOINT)


def _block(
    motion: Motion,
    ids,
    jacobian,
    violation,
    parameters,
    type_: RowType,
    movable: Array | bool = True,
) -> Block:
    """A block; rows are active where `violation` is negative and `movable`."""
    opt, velocity = motion.model.opt, row_velocity(motion, jacobian)
    solref, solimp, weight = parameters
    weight = row_inertia(motion, jacobian, weight)

    def row(active, violation, velocity, solref, solimp, weight):
        r = response(opt, solref, solimp, violation)
        aref = jnp.where(active, r.reference(velocity, violation), 0.0)
        return aref, inverse_where(active, r.regularisation(weight))

    def cost(violation):
        active = (violation < 0) & movable
        aref, D = jax.vmap(row)(active, violation, velocity, solref, solimp, weight)
        return Unilateral(aref=aref, D=D)

    block = Block(cost(violation), jacobian, type_, tuple(ids.tolist()), violation)
    if not motion.model.backward.entry_time:
        return block
    responses = jax.vmap(functools.partial(response, opt))(solref, solimp, violation)
    return block.replace(entry=entry(opt.timestep, violation, velocity, cost, responses, weight))
