"""Dry friction of joints and tendons."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.arrays.indexing import take
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.impedance import response
from jaxsim.constraint.jacobian import DenseRows, DofRows, row_velocity
from jaxsim.constraint.row_inertia import row_inertia
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.tendons.tendon import tendon_jacobian
from jaxsim.model.dof_order import to_tree_order
from jaxsim.solver import Huber

_FRICTION_OFF = mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS


def friction_blocks(motion: Motion) -> list[Block]:
    """Rows of the degrees of freedom and tendons that may have dry friction."""
    model = motion.model
    if model.opt.disabled(_FRICTION_OFF):
        return []
    blocks = []
    dofs = np.array(model.nonzero_rows("dof_frictionloss"), int)
    tendons = np.array(model.nonzero_rows("tendon_frictionloss"), int)
    if len(dofs):
        rows = DofRows(jnp.ones(len(dofs), motion.qvel.dtype), _tree_dofs(model, dofs))
        parameters = (
            model.dof_solref,
            model.dof_solimp,
            model.dof_invweight0,
            model.dof_frictionloss,
        )
        blocks.append(_block(motion, rows, dofs, parameters, RowType.FRICTION_DOF))
    if len(tendons):
        rows = DenseRows(
            to_tree_order(model, take(tendon_jacobian(model, motion.kin), tendons).T).T
        )
        parameters = (
            model.tendon_solref_fri,
            model.tendon_solimp_fri,
            model.tendon_invweight0,
            model.tendon_frictionloss,
        )
        blocks.append(_block(motion, rows, tendons, parameters, RowType.FRICTION_TENDON))
    return blocks


def _block(motion: Motion, jacobian, ids: np.ndarray, parameters, type_: RowType) -> Block:
    """A block; its reference acceleration only damps, as dry friction has no rest position."""
    velocity = row_velocity(motion, jacobian)

    def row(velocity, solref, solimp, weight):
        r = response(motion.model.opt, solref, solimp, jnp.zeros_like(velocity))
        return -r.damping * velocity, r.regularisation(weight)

    solref, solimp, weight, floss = (take(p, ids) for p in parameters)
    weight = row_inertia(motion, jacobian, weight)
    aref, R = jax.vmap(row)(velocity, solref, solimp, weight)
    kind = Huber(aref=aref, D=1 / R, floss=floss)
    return Block(kind, jacobian, type_, tuple(ids.tolist()), weight=weight)


def _tree_dofs(model, dofs: np.ndarray) -> tuple[int, ...]:
    return tuple(int(d) for d in model.structure.dof_position[dofs])
