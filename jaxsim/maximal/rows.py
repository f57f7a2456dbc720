"""Rows of free bodies: those of the joints, of their armature, and of the tree's constraints."""

from collections.abc import Iterator

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather_or_zero, take
from jaxsim.constraint import Block, RowType
from jaxsim.constraint.equality import equality_blocks
from jaxsim.constraint.friction import friction_blocks
from jaxsim.constraint.jacobian import DenseRows
from jaxsim.constraint.laws import RIGID
from jaxsim.constraint.limit import limit_blocks
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.maximal.coordinates import JointMotion, Links
from jaxsim.model import Model
from jaxsim.model.dof_order import to_tree_order
from jaxsim.solver import Quadratic
from jaxsim.solver.passes import softness


def joint_rows(free: Model, tree: Model, joints: JointMotion) -> Iterator[Block]:
    """Rigid rows by which bodies stay at their joints; none if all are free already.

    The error decays as that of a critically damped spring with a time constant of two steps. Beside
    rigid contacts, which may not let bodies move so, velocities have no part in it: bodies are
    displaced, as those that penetrate (`jaxsim.constraint.rigid.displacement`).
    """
    held = Links.of(tree).held
    if not len(held):
        return
    error, rate, rows, bias = (
        take(x, held) for x in (joints.error, joints.error_rate, joints.rows, joints.bias)
    )
    time = 2 * free.opt.timestep
    displaced = free.contact in RIGID
    aref = -2 / time * rate - bias
    aref = aref if displaced else aref - error / time**2
    D = 1 / (softness(error.dtype) * take(_inverse_inertia(tree), held))
    block = Block(Quadratic(aref, D), _dense(free, rows), RowType.HOLD, rigid=True)
    yield block.replace(violation=error) if displaced else block


def reflected_rows(free: Model, tree: Model, joints: JointMotion, damping) -> Block:
    """Rows of the energy of the joints' accelerations, `1/2 (armature + damping) q''^2`."""
    inertia = dof_armature(tree) + damping
    kind = Quadratic(-joints.rates_bias, inertia)
    return Block(kind, _dense(free, joints.rates), RowType.REFLECTED)


def tree_rows(free: Model, motion: Motion, joints: JointMotion) -> Iterator[Block]:
    """The equalities, dry friction and limits of the tree, as rows over the free bodies.

    Args:
      free: the model of the free bodies.
      motion: of the tree.
      joints: its coordinates.
    """
    tree = motion.model
    rates, bias = (to_tree_order(tree, x) for x in (joints.rates, joints.rates_bias))
    for block in [*equality_blocks(motion), *friction_blocks(motion), *limit_blocks(motion)]:
        J = block.jacobian.dense(tree.tree, motion.kin.cdof)
        kind = block.kind.replace(aref=block.kind.aref - J @ bias)
        yield block.replace(kind=kind, jacobian=_dense(free, J @ rates))


def _inverse_inertia(tree: Model) -> Float[Array, "m 6"]:
    """Mean inverse inertia of the rows of each moving body: its own and its parent's."""
    links = Links.of(tree)
    mass, inertia = take(tree.body_mass, links.body), take(tree.body_inertia, links.body)
    own = jnp.stack([1 / mass, jnp.mean(1 / inertia, axis=1)], axis=1)
    both = own + gather_or_zero(own, links.parent_index)
    return jnp.repeat(both, 3, axis=1)


def _dense(free: Model, rows: Float[Array, "*rows nv"]) -> DenseRows:
    """Rows given in MuJoCo's order of the free bodies' degrees of freedom."""
    return DenseRows(jnp.moveaxis(to_tree_order(free, jnp.moveaxis(rows, -1, 0)), 0, -1))
