"""The four joint types: what a joint's coordinates do to its link.

Each function handles one joint. A ball or free joint stores a unit quaternion and its angular
velocity in the axes of the moving link; a free joint's linear velocity is in world axes.
"""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.spatial import (
    Pose,
    quat_difference,
    quat_from_axis_angle,
    quat_integrate,
    quat_normalize,
    quat_rotate,
)

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
BALL = int(mujoco.mjtJoint.mjJNT_BALL)
SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)

# Number of coordinates in qpos.
NQ = {FREE: 7, BALL: 4, SLIDE: 1, HINGE: 1}


def joint_pose(
    kind: int,
    q: Float[Array, "nq"],
    q0: Float[Array, "nq"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Pose:
    """Pose of the link in its joint frame (for a free joint: in the world).

    Args:
      kind: the joint's type, static.
      q: the joint's coordinates.
      q0: its coordinates in the model's reference configuration.
      axis: unit axis in the link frame.
      anchor: point of the link that a rotation leaves in place (m).
    """
    if kind == FREE:
        return Pose(quat=quat_normalize(q[3:]), pos=q[:3])
    if kind == SLIDE:
        quat = jnp.zeros(4, q.dtype).at[0].set(1.0)
        return Pose(quat=quat, pos=axis * (q - q0))
    quat = quat_normalize(q) if kind == BALL else quat_from_axis_angle(axis, (q - q0)[0])
    return Pose(quat=quat, pos=anchor - quat_rotate(quat, anchor))


def motion_subspace(
    kind: int,
    mat: Float[Array, "3 3"],
    pos: Float[Array, "3"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Float[Array, "nv 6"]:
    """Twists per unit joint velocity, one row per degree of freedom.

    Args:
      kind: the joint's type, static.
      mat: orientation of the link in the world.
      pos: origin of the link from the reference point, world axes (m).
      axis: unit axis in the link frame.
      anchor: rotation centre in the link frame (m).
    """
    zero = jnp.zeros((3, 3), mat.dtype)
    if kind == SLIDE:
        return jnp.concatenate([zero[0], mat @ axis])[None]
    if kind == HINGE:
        direction = mat @ axis
        return jnp.concatenate([direction, jnp.cross(pos + mat @ anchor, direction)])[None]
    # Rotations about the link's own axes, which are the columns of `mat`.
    centre = pos if kind == FREE else pos + mat @ anchor
    moments = jnp.stack([jnp.cross(centre, mat[:, k]) for k in range(3)])
    rotations = jnp.concatenate([mat.T, moments], axis=1)
    if kind == BALL:
        return rotations
    translations = jnp.concatenate([zero, jnp.eye(3, dtype=mat.dtype)], axis=1)
    return jnp.concatenate([translations, rotations])


def integrate_joint(
    kind: int, q: Float[Array, "nq"], v: Float[Array, "nv"], dt: Float[Array, ""] | float
) -> Float[Array, "nq"]:
    """Coordinates after moving at constant joint velocity for `dt` seconds."""
    if kind == FREE:
        return jnp.concatenate([q[:3] + v[:3] * dt, quat_integrate(q[3:], v[3:], dt)])
    if kind == BALL:
        return quat_integrate(q, v, dt)
    return q + v * dt


def joint_difference(
    kind: int, q1: Float[Array, "nq"], q2: Float[Array, "nq"]
) -> Float[Array, "nv"]:
    """Joint velocity that leads from `q1` to `q2` in one second; inverts `integrate_joint`."""
    if kind == FREE:
        return jnp.concatenate([q2[:3] - q1[:3], quat_difference(q1[3:], q2[3:])])
    if kind == BALL:
        return quat_difference(q1, q2)
    return q2 - q1
