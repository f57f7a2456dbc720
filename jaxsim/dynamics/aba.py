"""The articulated body algorithm: forward dynamics and solves with the mass matrix in O(n).

Featherstone, Rigid Body Dynamics Algorithms (2008), section 7.3, in world axes.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.batching.matrices import solve
from jaxsim.dynamics.components import motion_components, restrict, restrict_matrix
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import qfrc_bias
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia
from jaxsim.dynamics.tree import inward, outward
from jaxsim.dynamics.velocity import velocities
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order, to_tree_order
from jaxsim.model.inputs import admit_array, admit_model
from jaxsim.model.topology import Forest

# Lower bound of pivots, in units of the estimated rounding error.
_UNITS = 16


@full_precision
def forward_dynamics(
    model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"], tau: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """Accelerations under generalised forces and gravity, `M^-1 (tau - qfrc_bias)`.

    Args:
      model: the model.
      qpos: coordinates.
      qvel: velocities.
      tau: generalised forces (N or N m).

    Returns:
      Accelerations without constraints; `inverse_dynamics` inverts this.

    Raises:
      TypeError: an argument is of the wrong class, or its numbers are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, qpos = admit_model(model), admit_array(model, qpos, (model.nq,), "qpos")
    qvel = admit_array(model, qvel, (model.nv,), "qvel")
    tau = admit_array(model, tau, (model.nv,), "tau")
    kin = kinematics(model, qpos)
    return solve_mass(model, kin, tau - qfrc_bias(model, kin, velocities(model, kin, qvel)))


def solve_mass(model: Model, kin: Kinematics, force: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """`M^-1 force`, armature included; in O(n) unless tendons have armature."""
    if has_tendon_inertia(model):
        return solve(composite_mass_matrix(model, kin), force)
    matrices = jax.vmap(lambda inertia: inertia.as_matrix())(kin.inertia)
    return solve_articulated(model, kin.cdof, matrices, dof_armature(model), force)


def solve_articulated(
    model: Model,
    cdof: Float[Array, "nv 6"],
    link_matrix: Float[Array, "njnt 6 6"],
    diagonal: Float[Array, "nv"],
    force: Float[Array, "nv"],
) -> Float[Array, "nv"]:
    """Solve `H x = force` with the mass matrix of a tree whose links have arbitrary 6x6 inertias.

    `H = sum_links J^T K J + diag(d)` must be positive definite; each K is symmetric. Contacts with
    the world add to K and joint limits add to d, so that this is the Newton step of the constraint
    problem.

    Args:
      model: the model.
      cdof: motion axes, tree order.
      link_matrix: K of each link about the tree's reference point, tree order.
      diagonal: d, which includes armature, MuJoCo's order.
      force: right-hand side, MuJoCo's order.

    Returns:
      `H^-1 force`, MuJoCo's order.
    """
    components = motion_components(model)
    cdof = restrict(components, cdof)
    link_matrix = jax.vmap(lambda matrix: restrict_matrix(components, matrix))(link_matrix)
    diagonal, force = to_tree_order(model, diagonal), to_tree_order(model, force)
    return from_tree_order(
        model, articulated_solve(model.tree, cdof, link_matrix, diagonal, force)[0]
    )


def articulated_solve(
    tree: Forest,
    cdof: Float[Array, "nv c"],
    link_matrix: Float[Array, "njnt c c"],
    diagonal: Float[Array, "nv"],
    force: Float[Array, "nv"],
) -> tuple[Float[Array, "nv"], Float[Array, "njnt c"]]:
    """`solve_articulated` in tree order, for twists with c components.

    Returns:
      The solution x, and the twists `sum cdof x` of the links (for forces: accelerations).
    """
    c = cdof.shape[1]
    zero = (jnp.zeros((c, c), cdof.dtype), jnp.zeros(c, cdof.dtype))
    _, (gain, offset) = inward(tree, _eliminate, zero, link_matrix, (cdof, diagonal, force))
    # The parents of the first level do not accelerate, so its gains are not needed.
    first = tree.levels[0].ndof if len(tree) else 0
    gain = jnp.concatenate([jnp.zeros_like(gain[:first]), gain[first:]])
    root = jnp.zeros((tree.nroot, c), cdof.dtype)
    acceleration, x = outward(tree, _substitute, root, (), (cdof, gain, offset))
    return x, acceleration


def _eliminate(children, matrix, dofs):
    """Articulated inertia and bias force of a subtree as seen by the parent link."""
    (articulated, bias), (S, diagonal, force) = children, dofs
    articulated = articulated + matrix
    U = S @ articulated
    joint = S @ U.T + jnp.diag(diagonal)
    smallest = _rounding(articulated, S, diagonal) if len(S) > 1 else None
    gain, offset = _solve_joint(joint, smallest, U, force - S @ bias)
    return (articulated - U.T @ gain, bias + U.T @ offset), (gain, offset)


def _rounding(articulated, S, diagonal):
    """(n,) bound on the rounding error in the diagonal of `S articulated S^T + diag(diagonal)`.

    With stiff contacts on a slender or light body, the inertia of some motion can be below it.
    """
    size = (S * S) @ jnp.diagonal(articulated) + diagonal
    return lax.stop_gradient(_UNITS * jnp.finfo(size.dtype).eps * size)


def _substitute(parent, _, dofs):
    """The link's and the joint's acceleration from the parent link's."""
    S, gain, offset = dofs
    x = offset - gain @ parent
    return parent + x @ S, x


def _solve_joint(joint, smallest, U, u):
    """`joint^-1 U` and `joint^-1 u`.

    The factors are applied one after the other, because their product, the inverse, loses all
    accuracy where contact stiffness exceeds the joint's inertia by 1e6. The two right-hand sides
    are solved separately, so that reverse mode sees that the second solve is linear in u.
    """
    n = joint.shape[0]
    if n == 1:
        inverse = 1 / joint[0, 0]
        return inverse * U, inverse * u
    X, pivots = _factor(joint, smallest)
    return X.T @ ((X @ U) / pivots[:, None]), X.T @ ((X @ u) / pivots)


def _factor(A, smallest):
    """X and D of `A^-1 = X^T D^-1 X`, where `X = L^-1` and `A = L D L^T`.

    Each step eliminates in all rows; rows that are finished stay zero.
    """
    n = len(A)
    rest, rows, pivots = jnp.concatenate([A, jnp.eye(n, dtype=A.dtype)], axis=1), [], []
    for j in range(n):
        row, pivot = rest[j], jnp.maximum(rest[j, j], smallest[j])
        rows.append(row)
        pivots.append(pivot)
        if j + 1 < n:
            scaled = row / pivot
            # Without a barrier XLA recomputes it for each of its rows and columns.
            rest = lax.optimization_barrier(rest - rest[:, j][:, None] * scaled[None])
    return jnp.stack(rows)[:, n:], jnp.stack(pivots)
