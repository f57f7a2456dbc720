"""Anchors and axes of joints in the world, as MuJoCo's `xanchor` and `xaxis` define them."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics, joint_poses
from jaxsim.dynamics.links import link_parameters
from jaxsim.joints import FREE
from jaxsim.model import Model
from jaxsim.spatial import Pose, quat_rotate

Anchors = tuple[Float[Array, "njnt 3"], Float[Array, "njnt 3"]]


def joint_frames(model: Model, kin: Kinematics, qpos: Float[Array, "nq"]) -> Anchors:
    """Anchors (m) and axes of all joints before each has moved its body; see `mj_kinematics`.

    Of a joint with pose `X(q)` in a link of pose `X_link`, they are those of `X_link X(q)^-1`. A
    free joint has the position of its body, and its axis is not turned.

    Args:
      model: the model.
      kin: its kinematics.
      qpos: coordinates.
    """
    tree, links = model.tree, link_parameters(model)

    def one(link: Pose, moved: Pose, anchor, axis):
        before = link @ moved.inverse()
        return before.apply(anchor), quat_rotate(before.quat, axis)

    moved = joint_poses(model, links, qpos)
    anchor, axis = jax.vmap(one)(kin.link_pose, moved, links.anchor, links.axis)
    free = jnp.asarray(tree.kind == FREE.number)[:, None]
    anchor = jnp.where(free, kin.link_pose.pos, anchor)
    axis = jnp.where(free, links.axis, axis)
    return take(anchor, tree.position), take(axis, tree.position)
