"""Rotation matrices: the group SO(3) and its algebra of skew-symmetric matrices."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.spatial.quaternion import quat_exp, quat_from_matrix, quat_log, quat_to_matrix


def skew(v: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The matrix of the cross product: ``skew(v) @ u == cross(v, u)``."""
    x, y, z = v
    zero = jnp.zeros_like(x)
    return jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)


def unskew(S: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Inverse of :func:`skew`; the symmetric part of the argument is ignored.

    Raises:
        ValueError: the shape is not (3, 3).
    """
    if np.shape(S) != (3, 3):
        raise ValueError(f"a skew-symmetric matrix has shape (3, 3), not {np.shape(S)}")
    return 0.5 * jnp.stack([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]])


def so3_exp(w: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rotation matrix of a rotation vector, ``exp(skew(w))``; smooth everywhere."""
    return quat_to_matrix(quat_exp(w))


def so3_log(R: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Rotation vector of a rotation matrix, ``|w| <= pi``.

    Goes through the quaternion, which keeps all digits at the identity and at half a turn,
    where formulas with the trace of the matrix lose half of them.

    Raises:
        ValueError: the shape is not (3, 3).
    """
    return quat_log(quat_from_matrix(R))
