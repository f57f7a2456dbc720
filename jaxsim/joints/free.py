"""The free joint: six degrees of freedom.

Its coordinates are a position in the world (m) and a unit quaternion. Its velocity is the linear
velocity in the world's axes (m/s) and the angular velocity in the link's axes (rad/s).
"""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.joints.ball import BALL, rotations, torque
from jaxsim.joints.joint import Joint
from jaxsim.spatial import Pose, quat_normalize


def _pose(
    q: Float[Array, "7"],
    q0: Float[Array, "7"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Pose:
    return Pose(quat=quat_normalize(q[3:]), pos=q[:3])


def _motion_axes(
    mat: Float[Array, "3 3"],
    pos: Float[Array, "3"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Float[Array, "6 6"]:
    translations = jnp.eye(6, dtype=mat.dtype)[3:]
    return jnp.concatenate([translations, rotations(mat, pos)])


def _integrate(
    q: Float[Array, "7"], v: Float[Array, "6"], dt: Float[Array, ""] | float
) -> Float[Array, "7"]:
    return jnp.concatenate([q[:3] + v[:3] * dt, BALL.integrate(q[3:], v[3:], dt)])


def _difference(q1: Float[Array, "7"], q2: Float[Array, "7"]) -> Float[Array, "6"]:
    return jnp.concatenate([q2[:3] - q1[:3], BALL.difference(q1[3:], q2[3:])])


def _exponential_rate(v: Float[Array, "6"], theta: Float[Array, "6"]) -> Float[Array, "6"]:
    return jnp.concatenate([v[:3], BALL.exponential_rate(v[3:], theta[3:])])


def _transmission(q: Float[Array, "7"], gear: Float[Array, "6"], in_parent: bool):
    """Length zero; moment: a force `gear[:3]` in the world's axes and a torque `gear[3:]`."""
    moment = jnp.concatenate([gear[:3], torque(q[3:], gear[3:], in_parent)])
    return jnp.zeros_like(gear[0]), moment


def _limit(q: Float[Array, "7"], bounds: Float[Array, "2"]):
    """A free joint has no limits."""
    infinite = jnp.full_like(bounds[0], jnp.inf)
    return infinite, infinite, jnp.zeros(6, q.dtype)


FREE = Joint(
    name="free",
    number=int(mujoco.mjtJoint.mjJNT_FREE),
    nq=7,
    nv=6,
    turns=(False,) * 3 + (True,) * 3,
    parts=(3, 3),
    pose=_pose,
    motion_axes=_motion_axes,
    integrate=_integrate,
    difference=_difference,
    exponential_rate=_exponential_rate,
    transmission=_transmission,
    limit=_limit,
    in_world=True,
)
