"""The slide joint: a translation along an axis, in metres."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.joints.scalar import scalar_joint
from jaxsim.spatial import Pose


def _pose(
    q: Float[Array, "1"],
    q0: Float[Array, "1"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Pose:
    return Pose(quat=jnp.zeros(4, q.dtype).at[0].set(1.0), pos=axis * (q - q0))


def _motion_axes(
    mat: Float[Array, "3 3"],
    pos: Float[Array, "3"],
    axis: Float[Array, "3"],
    anchor: Float[Array, "3"],
) -> Float[Array, "1 6"]:
    return jnp.concatenate([jnp.zeros(3, mat.dtype), mat @ axis])[None]


SLIDE = scalar_joint(
    "slide", int(mujoco.mjtJoint.mjJNT_SLIDE), _pose, _motion_axes, slides_along_axis=True
)
