"""Composite rigid bodies: the mass matrix.

Featherstone, Rigid Body Dynamics Algorithms (2008), section 6.2.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.tree import accumulate_inward, take
from jaxsim.dynamics.velocity import from_tree_order, to_tree_order
from jaxsim.model import Model


def mass_matrix(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, "nv nv"]:
    """Mass matrix in joint space, armature included; symmetric positive definite.

    Args:
      model: the model.
      qpos: coordinates.
    """
    return composite_mass_matrix(model, kinematics(model, qpos))


def composite_mass_matrix(model: Model, kin: Kinematics) -> Float[Array, "nv nv"]:
    """The mass matrix from known kinematics."""
    mass = composite_mass_matrix_in_tree_order(model, kin)
    return from_tree_order(model, from_tree_order(model, mass).T)


def composite_mass_matrix_in_tree_order(model: Model, kin: Kinematics) -> Float[Array, "nv nv"]:
    """`M_ij = cdof_i . (I_c cdof_j)` where i moves j's link, I_c the inertia of j's subtree."""
    tree = model.tree
    composite = accumulate_inward(tree, kin.inertia)
    each = jax.tree.map(lambda a: take(a, tree.dof_node), composite)
    momentum = jax.vmap(lambda inertia, axis: inertia.apply(axis))(each, kin.cdof)
    products = momentum @ kin.cdof.T
    # [j, i] where dof i moves the link of dof j; within one joint each dof moves the others.
    related = tree.moves[tree.dof_node]
    lower = jnp.where(related, products, 0)
    same = np.asarray(tree.dof_node[:, None] == tree.dof_node[None, :])
    full = lower + jnp.where(same, 0, lower.T)
    return full + jnp.diag(to_tree_order(model, dof_armature(model)))
