"""A screw, as an example of another joint type: it turns about its axis and advances along it."""

import jax.numpy as jnp
import mujoco

from jaxsim.joints.scalar import scalar_joint
from jaxsim.spatial import Pose, quat_from_axis_angle, quat_rotate

PITCH = 0.3  # metres per radian


def _pose(q, q0, axis, anchor):
    angle = (q - q0)[0]
    quat = quat_from_axis_angle(axis, angle)
    return Pose(quat=quat, pos=anchor - quat_rotate(quat, anchor) + PITCH * angle * axis)


def _motion_axes(mat, pos, axis, anchor):
    direction = mat @ axis
    moment = jnp.cross(pos + mat @ anchor, direction)
    return jnp.concatenate([direction, moment + PITCH * direction])[None]


# It takes the number of the hinge, which models then have screws in place of.
HELICAL = scalar_joint(
    "helical",
    int(mujoco.mjtJoint.mjJNT_HINGE),
    _pose,
    _motion_axes,
    turns_about_axis=True,
    slides_along_axis=True,
)
