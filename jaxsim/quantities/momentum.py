"""Momentum of the whole model and of its subtrees."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tree import accumulate_inward, inward
from jaxsim.dynamics.velocity import Velocities, body_twists
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order
from jaxsim.spatial import wrench_from


def center_of_mass(kin: Kinematics) -> Float[Array, "3"]:
    """Centre of mass of all bodies, including those that never move (m)."""
    return kin.subtree_com[0]


def centroidal_momentum_matrix(model: Model, kin: Kinematics) -> Float[Array, "6 nv"]:
    """Centroidal momentum matrix A: `A qvel` is the momentum (angular, linear) about the com.

    Column j is the momentum of j's subtree when only degree of freedom j moves, at unit speed
    (Orin, Goswami and Lee, Centroidal dynamics of a humanoid robot, 2013). Armature does not
    contribute.

    Args:
      model: the model.
      kin: its kinematics.
    """
    tree = model.tree
    composite = jax.tree.map(lambda a: take(a, tree.dof_node), accumulate_inward(tree, kin.inertia))
    momentum = jax.vmap(lambda inertia, axis: inertia.apply(axis))(composite, kin.cdof)
    arm = take(kin.origin, tree.root[tree.dof_node]) - center_of_mass(kin)[None]
    return from_tree_order(model, jax.vmap(wrench_from)(momentum, arm)).T


def centroidal_momentum(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "6"]:
    """Momentum `(angular, linear)` about the centre of mass, world axes (N m s, N s).

    Both parts are conserved without external forces.
    """
    tree = model.tree
    momentum = jax.vmap(lambda inertia, v: inertia.apply(v))(kin.inertia, vel.cvel)
    arm = take(kin.origin, tree.root) - center_of_mass(kin)[None]
    return jax.vmap(wrench_from)(momentum, arm).sum(0)


def subtree_velocities(
    model: Model, kin: Kinematics, vel: Velocities
) -> tuple[Float[Array, "nbody 3"], Float[Array, "nbody 3"]]:
    """Velocity of each subtree's centre of mass, and its angular momentum about that point.

    As MuJoCo's `mj_subtreeVel`: `subtree_linvel` (m/s) and `subtree_angmom` (N m s). Angular
    momenta are moved from one centre of mass to the next, so that large distances between bodies
    or to the world's origin cost no accuracy.
    """
    forest = model.structure.body_tree
    angular, linear = _body_momenta(model, kin, vel)
    com = kin.subtree_com
    above = take(com, model.body_parentid)
    nodes = (model.body_mass, angular, linear, kin.xipos, com, above)
    nodes = jax.tree.map(lambda a: take(a, forest.order), nodes)
    zero = (jnp.zeros((), com.dtype), jnp.zeros(3, com.dtype), jnp.zeros(3, com.dtype))
    (mass, moment, momentum), _ = inward(forest, _gather_momentum, zero, nodes)
    mass, moment, momentum = (take(a, forest.position) for a in (mass, moment, momentum))
    light = mass < MINVAL
    mean = momentum / jnp.where(light, 1.0, mass)[:, None]
    linvel = jnp.where(light[:, None], 0, mean)
    return linvel, moment - jnp.cross(com - above, momentum)


def _gather_momentum(children, body, _):
    """Mass, angular momentum about the parent's centre of mass, and linear momentum."""
    mass, moment, momentum = children
    m, angular, linear, xipos, com, above = body
    moment = moment + angular + jnp.cross(xipos - com, linear)
    momentum = momentum + linear
    return (mass + m, moment + jnp.cross(com - above, momentum), momentum), ()


def _body_momenta(model: Model, kin: Kinematics, vel: Velocities):
    """Angular momentum of each body about its own centre of mass, and its linear momentum."""
    twists = body_twists(model, kin, vel.cvel, kin.xipos)

    def spin(R, inertia, omega):
        return R @ (inertia * (R.T @ omega))

    angular = jax.vmap(spin)(kin.ximat, model.body_inertia, twists[:, :3])
    return angular, model.body_mass[:, None] * twists[:, 3:]
