"""Limits of joints and tendons.

Of a range wider than both margins only one end can be active, so one row serves both. Otherwise
each end has a row.
"""

import functools
from collections.abc import Callable

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

# From distances to the lower and the upper end, and the derivative of the limited quantity: the
# distance that a row bounds, and its derivative.
_End = Callable[[Array, Array, Array], tuple[Array, Array]]

_LIMIT_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT


def limit_blocks(motion: Motion) -> list[Block]:
    """Rows of limited joints, one block for each kind of limit, and of limited tendons."""
    model = motion.model
    if model.opt.disabled(_LIMIT_OFF):
        return []
    joints, tendons = model.jnt_limited.astype(bool), model.tendon_limited.astype(bool)
    blocks = []
    for end, has_joint, has_tendon in (
        (_nearer_end, ~model.jnt_limits_meet, ~model.tendon_limits_meet),
        (_lower_end, model.jnt_limits_meet, model.tendon_limits_meet),
        (_upper_end, model.jnt_limits_meet, model.tendon_limits_meet),
    ):
        ids, tendon = np.flatnonzero(joints & has_joint), np.flatnonzero(tendons & has_tendon)
        kinds = shared_type(model.jnt_type[ids], "limit")
        blocks += [_joints(motion, ids[kinds == k], end) for k in np.unique(kinds)]
        blocks += [_tendons(motion, tendon, end)] if len(tendon) else []
    return blocks


def _joints(motion: Motion, ids: np.ndarray, end: _End) -> Block:
    """Rows of joints of one kind."""
    model, joint = motion.model, JOINTS[int(motion.model.jnt_type[ids[0]])]
    lower, upper, gradient = jax.vmap(joint.limit)(
        position_rows(model, motion.qpos, ids).blocks(), take(model.jnt_range, ids)
    )
    distance, gradient = end(lower, upper, gradient)
    violation = distance - take(model.jnt_margin, ids)
    dofs = model.structure.dof_position[model.jnt_dofadr[ids][:, None] + np.arange(joint.nv)]
    return _joint_block(motion, ids, _rows(model, gradient, dofs), violation)


def _rows(model: Model, gradient, dofs: np.ndarray):
    """Rows with these derivatives (n, k) with respect to degrees of freedom (n, k)."""
    n, nv = dofs.shape
    if nv == 1:
        return DofRows(gradient[:, 0], tuple(dofs[:, 0].tolist()))
    J = jnp.zeros((n, model.nv), gradient.dtype)
    return DenseRows(J.at[np.arange(n)[:, None], dofs].set(gradient))


def _tendons(motion: Motion, ids: np.ndarray, end: _End) -> Block:
    """Rows of limited tendons."""
    model = motion.model
    length, bounds = take(motion.kin.ten_length, ids), take(model.tendon_range, ids)
    jacobian = take(tendon_jacobian(model, motion.kin), ids)
    distance, J = end(length - bounds[:, 0], bounds[:, 1] - length, jacobian)
    violation = distance - take(model.tendon_margin, ids)
    parameters = (
        take(model.tendon_solref_lim, ids),
        take(model.tendon_solimp_lim, ids),
        take(model.tendon_invweight0, ids),
    )
    rows = DenseRows(to_tree_order(model, J.T).T)
    return _block(motion, ids, rows, violation, parameters, RowType.LIMIT_TENDON, moves_anything(J))


def _nearer_end(lower, upper, gradient):
    """Distance to the nearer end of each range, and its gradient."""
    below = lower < upper
    return jnp.where(below, lower, upper), jnp.where(below[:, None], gradient, -gradient)


def _lower_end(lower, upper, gradient):
    return lower, gradient


def _upper_end(lower, upper, gradient):
    return upper, -gradient


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
