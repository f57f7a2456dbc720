"""Velocities of the links, and their velocity-dependent accelerations."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather_or_zero, sum_by, take
from jaxsim.dynamics.free_bodies import free_dofs, free_links, replace_rows
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tree import accumulate_outward
from jaxsim.joints.grouping import turning
from jaxsim.model import Model
from jaxsim.model.dof_order import to_tree_order
from jaxsim.spatial import cross_motion, quat_to_matrix, twist_at


@struct.dataclass
class Velocities:
    """Twists of the links, tree order, world axes about the tree's reference point.

    Attributes:
      cvel: twist of each link.
      bias: acceleration of each link for zero `qacc` and gravity: the running sum of
        `d(cdof)/dt qvel` from the root outward.
      free: twists of the lone free bodies, in their own axes.
    """

    cvel: Float[Array, "njnt 6"]
    bias: Float[Array, "njnt 6"]
    free: Float[Array, "n 6"]


def velocities(model: Model, kin: Kinematics, qvel: Float[Array, "nv"]) -> Velocities:
    """Twists of the links, running sums of `cdof * qvel` from the roots outward, and their bias.

    The rate of a motion axis that turns with its link is `cvel x cdof`. The rate of the others,
    such as the translations of a free joint, is zero.
    """
    tree = model.tree
    joint, carried = joint_twists(model, kin, qvel)
    cvel = accumulate_outward(tree, joint)
    bias = accumulate_outward(tree, jax.vmap(cross_motion)(cvel, carried))
    return Velocities(cvel, bias, _free_twists(model, kin, qvel))


def _free_twists(model: Model, kin: Kinematics, qvel: Float[Array, "nv"]) -> Float[Array, "n 6"]:
    links = free_links(model)
    if not len(links):
        return jnp.zeros((0, 6), qvel.dtype)
    each = take(qvel, free_dofs(model).ravel()).reshape(-1, 6)
    mat = jax.vmap(quat_to_matrix)(take(kin.link_pose.quat, links))
    return jnp.concatenate([each[:, 3:], jax.vmap(jnp.matmul)(each[:, :3], mat)], axis=1)


def own_twists(model: Model, vel: Velocities) -> Float[Array, "njnt 6"]:
    """Twists of the links in the axes of `own_axes`, about the trees' reference points."""
    links = free_links(model)
    return replace_rows(vel.cvel, links, vel.free) if len(links) else vel.cvel


def joint_twists(
    model: Model, kin: Kinematics, qvel: Float[Array, "nv"]
) -> tuple[Float[Array, "njnt 6"], Float[Array, "njnt 6"]]:
    """`cdof * qvel` summed over each joint, and over its axes that turn with its link."""
    tree = model.tree
    each = kin.cdof * to_tree_order(model, qvel)[:, None]
    joint, turns = sum_by(each, tree.dof_node, len(tree)), turning(tree.kind)
    if turns.all():
        return joint, joint
    return joint, sum_by(jnp.where(turns[:, None], each, 0), tree.dof_node, len(tree))


def body_twists(
    model: Model,
    kin: Kinematics,
    link_twist: Float[Array, "njnt 6"],
    point: Float[Array, "n 3"],
    bodies: np.ndarray | None = None,
) -> Float[Array, "n 6"]:
    """Twists of bodies about given points, from the twists of the links.

    Args:
      model: the model.
      kin: its kinematics.
      link_twist: twists or spatial accelerations of the links about the tree's reference point.
      point: reference point for each body, world coordinates, for instance `kin.xipos` (m).
      bodies: (n,) bodies, which may repeat; None for all.

    Returns:
      `(omega, v)` of each body in world axes; zero for bodies that no joint moves.
    """
    link = model.body_link if bodies is None else model.body_link[bodies]
    (moving,) = np.nonzero(link >= 0)
    twist = take(link_twist, link[moving])
    arm = take(point, moving) - take(take(kin.origin, model.tree.root), link[moving])
    moved = jax.vmap(twist_at)(twist, arm)
    return gather_or_zero(moved, np.where(link >= 0, np.cumsum(link >= 0) - 1, -1))
