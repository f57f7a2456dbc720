"""The Coriolis matrix: velocity-dependent forces as a matrix times `qvel`.

Many matrices C have the right product `C qvel`. For this one, `dM/dt - 2 C` is skew-symmetric, the
property that passivity-based control needs: Coriolis forces do no work. It is the sum over links of
`J^T (G dJ/dt + B J)`, where G is the link's inertia and B a matrix such that `B v` is the link's
velocity-dependent force. Echeandia and Wensing, Numerical methods to compute the Coriolis
matrix and Christoffel symbols for rigid-body systems (2021), section 3.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tree import accumulate_inward
from jaxsim.dynamics.velocity import Velocities
from jaxsim.joints.grouping import turning
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order
from jaxsim.spatial import Inertia, ad, cross_motion, skew


def coriolis_matrix(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv nv"]:
    """C with `C qvel + gravity force = qfrc_bias`, and `dM/dt = C + C^T`.

    Armature of tendons is left out of all three.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its velocities.

    Returns:
      The matrix in MuJoCo's order of degrees of freedom.
    """
    tree = model.tree
    matrices = jax.vmap(Inertia.as_matrix)(kin.inertia)
    factors = jax.vmap(_link_factor)(kin.inertia, matrices, vel.cvel)
    inertia, factor = accumulate_inward(tree, (matrices, factors))
    inertia, factor = take(inertia, tree.dof_node), take(factor, tree.dof_node)
    rate = _axis_rates(model, kin, vel)
    # Rows i and columns j; the deeper of the two links carries all bodies that both dofs move.
    from_row = jax.vmap(lambda S, G, B: (S @ G, S @ B))(kin.cdof, inertia, factor)
    from_column = jax.vmap(lambda S, dS, G, B: G @ dS + B @ S)(kin.cdof, rate, inertia, factor)
    row_deeper = from_row[0] @ rate.T + from_row[1] @ kin.cdof.T
    column_deeper = kin.cdof @ from_column.T
    moves = tree.moves[tree.dof_node]
    matrix = jnp.where(moves, row_deeper, jnp.where(moves.T, column_deeper, 0))
    return from_tree_order(model, from_tree_order(model, matrix).T).T


def _link_factor(inertia: Inertia, matrix, v) -> Float[Array, "6 6"]:
    """B with `B v = v x* (G v)` and `dG/dt - 2 B` skew-symmetric, for one link."""
    momentum = inertia.apply(v)
    across = ad(v)
    return 0.5 * (-across.T @ matrix + _momentum_cross(momentum) - matrix @ across)


def _momentum_cross(h) -> Float[Array, "6 6"]:
    """Matrix X, skew-symmetric, with `X v = v x* h`."""
    angular, linear = -skew(h[:3]), -skew(h[3:])
    top = jnp.concatenate([angular, linear], axis=1)
    return jnp.concatenate([top, jnp.concatenate([linear, jnp.zeros_like(linear)], axis=1)])


def _axis_rates(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv 6"]:
    """Rates of the motion axes; zero for axes that do not turn with their links."""
    tree = model.tree
    rate = jax.vmap(cross_motion)(take(vel.cvel, tree.dof_node), kin.cdof)
    return jnp.where(turning(tree.kind)[:, None], rate, 0)
