"""The ball joint: a rotation about the anchor.

Its coordinates are a unit quaternion, its velocity the angular velocity in the link's axes (rad/s).
"""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.arrays.series import cotangent_defect
from jaxsim.joints.joint import Joint
from jaxsim.spatial import (
    Pose,
    quat_difference,
    quat_exp,
    quat_integrate,
    quat_inv_rotate,
    quat_log,
    quat_normalize,
    quat_rotate,
)


def _pose(
    q: Float[Array, "4"],
    q0: Float[Array, "4"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Pose:
    quat = quat_normalize(q)
    return Pose(quat=quat, pos=anchor - quat_rotate(quat, anchor))


def _motion_axes(
    mat: Float[Array, "3 3"],
    pos: Float[Array, "3"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Float[Array, "3 6"]:
    return rotations(mat, pos + mat @ anchor)


def rotations(mat: Float[Array, "3 3"], centre: Float[Array, "3"]) -> Float[Array, "3 6"]:
    """Motion axes of rotations about the link's axes, the columns of `mat`, through `centre`."""
    moments = jnp.stack([jnp.cross(centre, mat[:, k]) for k in range(3)])
    return jnp.concatenate([mat.T, moments], axis=1)


def _exponential_rate(v: Float[Array, "3"], theta: Float[Array, "3"]) -> Float[Array, "3"]:
    """`v + theta x v / 2 + c theta x (theta x v)`: the exponential map's inverse right Jacobian."""
    turned = jnp.cross(theta, v)
    return v + turned / 2 + cotangent_defect(theta @ theta) * jnp.cross(theta, turned)


def _transmission(q: Float[Array, "4"], gear: Float[Array, "6"], in_parent: bool):
    """Length: component of the rotation vector along `gear[:3]`; moment: a torque about it."""
    moment = torque(q, gear[:3], in_parent)
    return quat_log(quat_normalize(q)) @ moment, moment


def torque(q: Float[Array, "4"], gear: Float[Array, "3"], in_parent: bool) -> Float[Array, "3"]:
    """A torque in the link's axes; `gear` is in the parent's axes or already in the link's."""
    return quat_inv_rotate(quat_normalize(q), gear) if in_parent else gear


def _limit(q: Float[Array, "4"], bounds: Float[Array, "2"]):
    """The rotation angle has an upper limit only; its derivative is zero at the identity."""
    turn = quat_log(q)
    angle, divisor = norm_and_divisor(turn)
    return jnp.full_like(angle, jnp.inf), jnp.max(bounds) - angle, turn / divisor


def _clamp(q: Float[Array, "4"], bounds: Float[Array, "2"]) -> Float[Array, "4"]:
    """Reduce the rotation angle to the limit; the axis stays the same."""
    turn = quat_log(quat_normalize(q))
    angle, divisor = norm_and_divisor(turn)
    largest = jnp.max(bounds)
    return jnp.where(angle > largest, quat_exp(turn * (largest / divisor)), q)


BALL = Joint(
    name="ball",
    number=int(mujoco.mjtJoint.mjJNT_BALL),
    nq=4,
    nv=3,
    turns=(True,) * 3,
    parts=(3,),
    pose=_pose,
    motion_axes=_motion_axes,
    integrate=quat_integrate,
    difference=quat_difference,
    exponential_rate=_exponential_rate,
    transmission=_transmission,
    limit=_limit,
    clamp=_clamp,
    is_angle=True,
)
