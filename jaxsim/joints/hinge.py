"""The hinge joint: a rotation about an axis through the anchor, in radians."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.joints.scalar import scalar_joint
from jaxsim.spatial import Pose, quat_from_axis_angle, quat_rotate


def _pose(
    q: Float[Array, "1"],
    q0: Float[Array, "1"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Pose:
    quat = quat_from_axis_angle(axis, (q - q0)[0])
    return Pose(quat=quat, pos=anchor - quat_rotate(quat, anchor))


def _motion_axes(
    mat: Float[Array, "3 3"],
    pos: Float[Array, "3"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Float[Array, "1 6"]:
    direction = mat @ axis
    return jnp.concatenate([direction, jnp.cross(pos + mat @ anchor, direction)])[None]


HINGE = scalar_joint(
    "hinge", int(mujoco.mjtJoint.mjJNT_HINGE), _pose, _motion_axes, turns_about_axis=True
)
