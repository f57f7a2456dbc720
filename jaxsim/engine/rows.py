"""Constraint rows as MuJoCo lists them, `efc_J` and its companions."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import take
from jaxsim.collision import Contact
from jaxsim.constraint import Block, Constrained, RowType
from jaxsim.dynamics.motion import Motion
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order, to_tree_order
from jaxsim.solver import Huber, PyramidalCone, Unilateral

_EQUALITY = RowType.CONNECT, RowType.WELD, RowType.JOINT, RowType.TENDON
_TYPES = dict.fromkeys(_EQUALITY, int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)) | {
    RowType.FRICTION_DOF: int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF),
    RowType.FRICTION_TENDON: int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON),
    RowType.LIMIT_JOINT: int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT),
    RowType.LIMIT_TENDON: int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON),
}
_FRICTIONLESS = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
_PYRAMIDAL = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_PYRAMIDAL)
_ELLIPTIC = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC)


@struct.dataclass
class ConstraintRows:
    """All rows in MuJoCo's order; `ForwardDetails` describes the fields."""

    efc_type: Int[Array | np.ndarray, "nefc"]
    efc_id: Int[Array | np.ndarray, "nefc"]
    efc_J: Float[Array, "nefc nv"]
    efc_pos: Float[Array, "nefc"]
    efc_margin: Float[Array, "nefc"]
    efc_frictionloss: Float[Array, "nefc"]
    efc_D: Float[Array, "nefc"]
    efc_vel: Float[Array, "nefc"]
    efc_aref: Float[Array, "nefc"]
    efc_force: Float[Array, "nefc"]


def constraint_rows(motion: Motion, found: Constrained) -> ConstraintRows:
    """The rows of equalities, friction, limits and contacts, sorted by type and element."""
    parts, slots = [_no_rows(motion)], 0
    for block, force in zip(found.blocks, found.forces, strict=True):
        ids = np.array(block.ids, int)
        if block.type is RowType.CONTACT:
            ids = slots + np.arange(len(block.kind.aref))
            slots += len(ids)
        parts.append(_rows(motion, found, block, force, ids))
    types, ids, *rest = (
        list(column) for column in zip(*(vars(part).values() for part in parts), strict=True)
    )
    types, ids = np.concatenate(types), np.concatenate(ids)
    # Blocks differ in the kind of their rows, MuJoCo's order only in their types and elements.
    order = np.lexsort((ids, types))
    rest = [take(jnp.concatenate(column), order) for column in rest]
    return ConstraintRows(jnp.asarray(types[order]), jnp.asarray(ids[order]), *rest)


def _no_rows(motion: Motion) -> ConstraintRows:
    none = jnp.zeros(0, motion.qvel.dtype)
    J = jnp.zeros((0, motion.model.nv), none.dtype)
    return ConstraintRows(np.zeros(0, int), np.zeros(0, int), J, *[none] * 7)


def _rows(motion: Motion, found: Constrained, block: Block, force, ids: np.ndarray):
    """Rows of one block; inactive ones are zero except for position and margin."""
    model, kind = motion.model, block.kind
    J, aref, D = block.jacobian.dense(model.tree, motion.kin.cdof), kind.aref, kind.D
    if isinstance(kind, PyramidalCone):
        force = _edge_forces(motion, found, kind, J, force)
        J, aref = jax.vmap(kind.edges, -1, -1)(J), kind.edges(aref)
        D = jnp.broadcast_to(D[:, None], aref.shape)
    pos, margin = _position(model, found.contact, block, aref, ids)
    J = from_tree_order(model, jnp.where((D > 0)[..., None], J, 0).reshape(-1, model.nv).T).T
    floss = kind.floss if isinstance(kind, Huber) else jnp.zeros_like(aref)
    each = aref.size // len(ids)
    vel = (J @ motion.qvel).reshape(aref.shape)
    columns = (x.reshape(-1) for x in (pos, margin, floss, D, vel, aref, force))
    return ConstraintRows(np.full(aref.size, _row_type(block)), np.repeat(ids, each), J, *columns)


def _row_type(block: Block) -> int:
    if block.type is not RowType.CONTACT:
        return _TYPES[block.type]
    if isinstance(block.kind, PyramidalCone):
        return _PYRAMIDAL
    return _FRICTIONLESS if isinstance(block.kind, Unilateral) else _ELLIPTIC


def _position(model: Model, contact: Contact, block: Block, aref: Array, ids: np.ndarray):
    """`efc_pos` and `efc_margin`: friction has neither, rows of an elliptic cone share one."""
    zero = jnp.zeros_like(aref)
    if block.type is RowType.CONTACT:
        pos, margin = take(contact.dist, ids), take(contact.includemargin, ids)
        if isinstance(block.kind, PyramidalCone):
            return zero + pos[:, None], zero + margin[:, None]
        return zero.at[:, 0].set(pos), zero.at[:, 0].set(margin)
    if block.type is RowType.LIMIT_JOINT:
        margin = take(model.jnt_margin, ids)
    elif block.type is RowType.LIMIT_TENDON:
        margin = take(model.tendon_margin, ids)
    else:
        margin = zero
    return margin + (zero if block.violation is None else block.violation), margin


def _edge_forces(motion: Motion, found: Constrained, kind: PyramidalCone, J, force):
    """Forces along the edges of friction pyramids, whose rows are normals and tangents.

    After `noslip`, which acts on the rows, the surplus of the normal force is spread evenly.
    """
    if motion.model.opt.noslip_iterations:
        return kind.spread(force)
    qacc = to_tree_order(motion.model, found.qacc)
    return -kind.D[:, None] * jnp.minimum(kind.edges(J @ qacc - kind.aref), 0)
