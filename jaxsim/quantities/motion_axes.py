"""Motion axes of the degrees of freedom and their rates, in MuJoCo's com-based convention."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.velocity import Velocities, joint_twists
from jaxsim.joints.grouping import turning
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order
from jaxsim.spatial import cross_motion, twist_at


def cdof(model: Model, kin: Kinematics) -> Float[Array, "nv 6"]:
    """Twist of its body for each degree of freedom at unit speed, about the tree's com."""
    return from_tree_order(model, jax.vmap(twist_at)(kin.cdof, _arms(model, kin)))


def cdof_dot(
    model: Model, kin: Kinematics, vel: Velocities, qvel: Float[Array, "nv"]
) -> Float[Array, "nv 6"]:
    """Rates of `cdof` as `mj_comVel` defines them, `v x cdof`; zero for axes that do not turn.

    v is the twist of the link without what its own turning axes add. Their share cancels in
    `cdof_dot @ qvel`, and so in all accelerations.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its velocities.
      qvel: velocities of the degrees of freedom.
    """
    tree = model.tree
    carrier = vel.cvel - joint_twists(model, kin, qvel)[1]
    rates = jax.vmap(cross_motion)(take(carrier, tree.dof_node), kin.cdof)
    rates = jnp.where(jnp.asarray(turning(tree.kind))[:, None], rates, 0)
    return from_tree_order(model, jax.vmap(twist_at)(rates, _arms(model, kin)))


def _arms(model: Model, kin: Kinematics) -> Float[Array, "nv 3"]:
    """From each tree's reference point to its centre of mass, for each degree of freedom."""
    tree = model.tree
    body = model.body_rootid[model.jnt_bodyid[tree.order[tree.dof_node]]]
    return take(kin.subtree_com, body) - take(kin.origin, tree.root[tree.dof_node])
