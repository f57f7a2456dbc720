"""The composite rigid body algorithm: the mass matrix.

Featherstone, Rigid Body Dynamics Algorithms (2008), section 6.2.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia, tendon_inertia
from jaxsim.dynamics.tree import inward
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order, to_tree_order
from jaxsim.model.inputs import admit_array, admit_model
from jaxsim.model.topology import Forest


@full_precision
def mass_matrix(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, "nv nv"]:
    """Joint-space mass matrix with armature; symmetric and positive definite.

    Args:
      model: the model.
      qpos: coordinates.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, qpos = admit_model(model), admit_array(model, qpos, (model.nq,), "qpos")
    return composite_mass_matrix(model, kinematics(model, qpos))


def composite_mass_matrix(model: Model, kin: Kinematics) -> Float[Array, "nv nv"]:
    """The mass matrix in MuJoCo's order, from kinematics."""
    mass = tree_mass_matrix(model, kin)
    return mass + tendon_inertia(model, kin) if has_tendon_inertia(model) else mass


def tree_mass_matrix(model: Model, kin: Kinematics) -> Float[Array, "nv nv"]:
    """The mass matrix of the links and joints, without tendons' armature."""
    armature = to_tree_order(model, dof_armature(model))
    mass = composite_matrix(model.tree, kin.cdof, kin.inertia, armature)
    return from_tree_order(model, from_tree_order(model, mass).T)


def composite_matrix(
    tree: Forest, cdof: Float[Array, "nv c"], inertia: Any, diagonal: Float[Array, "nv"]
) -> Float[Array, "nv nv"]:
    """The matrix `H = sum_links J^T K J + diag(d)` with which `aba.articulated_solve` solves.

    `H_ij = cdof_i . (K_c cdof_j)` where i moves j's link; K_c is the sum of K over j's subtree.

    Args:
      tree: the links.
      cdof: motion axes, tree order.
      inertia: K of each link, a pytree that can be summed and whose `apply` multiplies a twist.
      diagonal: d, tree order.
    """
    zero = jax.tree.map(lambda a: jnp.zeros(a.shape[1:], a.dtype), inertia)
    _, momentum = inward(tree, _composite, zero, inertia, cdof)
    products = momentum @ cdof.T
    # [j, i]: whether dof i moves the link of dof j, which all dofs of one joint do for each other.
    related = tree.moves[tree.dof_node]
    full = jnp.where(related, products, jnp.where(related.T, products.T, 0))
    return full + jnp.diag(diagonal)


def _composite(children, own, axes):
    """The inertia of a subtree, and its momenta for unit velocities of the joint."""
    total = jax.tree.map(jnp.add, children, own)
    return total, jax.vmap(total.apply)(axes)
