"""Poses: the group SE(3) of rigid displacements, its exponential and its logarithm."""

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.series import cotangent_defect, sinc_half, sine_defect
from jaxsim.spatial.quaternion import (
    quat_conj,
    quat_exp,
    quat_from_matrix,
    quat_inv_rotate,
    quat_log,
    quat_mul,
    quat_rotate,
    quat_to_matrix,
)


@struct.dataclass
class Pose:
    """Pose ``X_AB`` of frame B in frame A; maps coordinates in B to coordinates in A.

    Attributes:
        quat: ``q_AB``, unit quaternion (w, x, y, z).
        pos: ``p_AB``, position of B's origin from A's origin, in the axes of A (m).
    """

    quat: Float[Array, "4"]
    pos: Float[Array, "3"]

    @classmethod
    def identity(cls, dtype=None) -> "Pose":
        """The pose of a frame in itself; ``dtype`` defaults to JAX's float type."""
        return cls(quat=jnp.eye(4, dtype=dtype)[0], pos=jnp.zeros(3, dtype=dtype))

    @classmethod
    def from_matrix(cls, T: Float[Array, "4 4"]) -> "Pose":
        """Pose of a homogeneous matrix ``[[R_AB, p_AB], [0, 1]]``.

        Raises:
            ValueError: the shape is not (4, 4); or ``T`` is a list or a NumPy array, not a JAX
                array, and is not the matrix of a rigid displacement.
        """
        if np.shape(T) != (4, 4):
            raise ValueError(f"the matrix of a pose has shape (4, 4), not {np.shape(T)}")
        if isinstance(T, list | tuple | np.ndarray):
            _check_displacement(np.asarray(T))
        T = jnp.asarray(T)
        return cls(quat=quat_from_matrix(T[:3, :3]), pos=T[:3, 3])

    def as_matrix(self) -> Float[Array, "4 4"]:
        """Homogeneous matrix ``[[R_AB, p_AB], [0, 1]]``."""
        top = jnp.concatenate([quat_to_matrix(self.quat), self.pos[:, None]], axis=1)
        return jnp.concatenate([top, jnp.eye(4, dtype=self.pos.dtype)[3:]])

    def compose(self, other: "Pose") -> "Pose":
        """``X_AC = X_AB.compose(X_BC)``, also written ``X_AB @ X_BC``."""
        return Pose(quat=quat_mul(self.quat, other.quat), pos=self.apply(other.pos))

    __matmul__ = compose

    def inverse(self) -> "Pose":
        """``X_BA`` from ``X_AB``."""
        return Pose(quat=quat_conj(self.quat), pos=-quat_inv_rotate(self.quat, self.pos))

    def apply(self, point: Float[Array, "3"]) -> Float[Array, "3"]:
        """Coordinates of a point: ``p_AQ = X_AB.apply(p_BQ)``."""
        return self.pos + quat_rotate(self.quat, point)


def se3_exp(V: Float[Array, "6"]) -> Pose:
    """Pose reached from the identity by a constant twist in unit time.

    With ``V = (w, v)`` and ``theta = |w|``: the rotation is ``exp(w)`` and the translation
    ``v + (1 - cos theta)/theta^2 w x v + (theta - sin theta)/theta^3 w x (w x v)``
    (Lynch and Park, Modern Robotics, eq. 3.88, with the screw axis not normalised).

    Args:
        V: twist times time, (rad, m), angular first.
    """
    w, v = V[:3], V[3:]
    theta_sq = w @ w
    # 1 - cos(theta) = 2 sin(theta / 2)^2 has no cancellation.
    first = 2 * sinc_half(theta_sq) ** 2
    wv = jnp.cross(w, v)
    pos = v + first * wv + sine_defect(theta_sq) * jnp.cross(w, wv)
    return Pose(quat=quat_exp(w), pos=pos)


def se3_log(X: Pose) -> Float[Array, "6"]:
    """Constant twist that reaches a pose in unit time, with ``|w| <= pi``; inverts `se3_exp`.

    ``v = p - w x p / 2 + (1 - (theta/2) cot(theta/2))/theta^2 w x (w x p)``.
    """
    w = quat_log(X.quat)
    wp = jnp.cross(w, X.pos)
    v = X.pos - 0.5 * wp + cotangent_defect(w @ w) * jnp.cross(w, wp)
    return jnp.concatenate([w, v])


def _check_displacement(T: np.ndarray) -> None:
    """Raise a ValueError unless a NumPy matrix is a rotation and a translation."""
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-4):
        raise ValueError("the upper left 3x3 block of a pose's matrix must be orthogonal")
    if np.linalg.det(T[:3, :3]) < 0:
        raise ValueError("the upper left 3x3 block of a pose's matrix must not be a reflection")
    if not np.allclose(T[3], [0, 0, 0, 1], atol=1e-6):
        raise ValueError(f"the last row of a pose's matrix must be (0, 0, 0, 1), not {T[3]}")
