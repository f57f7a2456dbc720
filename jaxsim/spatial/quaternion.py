"""Unit quaternions, the representation of rotations.

A quaternion is an array ``(w, x, y, z)``. ``q_AB`` turns the components of a vector in frame
B into its components in frame A, and products compose as ``q_AC = q_AB q_BC``. ``q`` and
``-q`` are the same rotation. Functions other than :func:`quat_normalize` and
:func:`quat_log` assume that the norm is one and do not check it.

Values and derivatives are finite at the identity, at half a turn, and for the zero
quaternion where :func:`quat_normalize` and :func:`quat_log` accept it.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.series import cos_half, horner, sinc_half

# Below this squared tangent of the half angle, the logarithm uses the series of atan(t) / t.
_SMALL_TANGENT_SQ = 1e-2
_ARCTANGENT = (1.0, -1 / 3, 1 / 5, -1 / 7, 1 / 9, -1 / 11, 1 / 13, -1 / 15)


def quat_mul(a: Float[Array, "4"], b: Float[Array, "4"]) -> Float[Array, "4"]:
    """Hamilton product, ``q_AC = q_AB q_BC``."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return jnp.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def quat_conj(q: Float[Array, "4"]) -> Float[Array, "4"]:
    """Conjugate, the inverse rotation of a unit quaternion: ``q_BA`` from ``q_AB``."""
    return jnp.concatenate([q[:1], -q[1:]])


def quat_rotate(q: Float[Array, "4"], v: Float[Array, "3"]) -> Float[Array, "3"]:
    """Components in A of a vector given in B, from ``q_AB``: ``v + 2 u x (q_w v + u x v)``."""
    u = q[1:]
    return v + 2 * jnp.cross(u, q[0] * v + jnp.cross(u, v))


def quat_inv_rotate(q: Float[Array, "4"], v: Float[Array, "3"]) -> Float[Array, "3"]:
    """Components in B of a vector given in A, from ``q_AB``; inverts :func:`quat_rotate`."""
    return quat_rotate(quat_conj(q), v)


def quat_normalize(q: Float[Array, "4"]) -> Float[Array, "4"]:
    """Scale to norm one; the identity, with zero derivative, if the norm is below `MINVAL`.

    The same choice as MuJoCo's ``mju_normalize4``.
    """
    norm_sq = q @ q
    vanishing = norm_sq < MINVAL**2
    norm = jnp.sqrt(jnp.where(vanishing, 1.0, norm_sq))
    return jnp.where(vanishing, jnp.eye(4, dtype=q.dtype)[0], q / norm)


def quat_exp(w: Float[Array, "3"]) -> Float[Array, "4"]:
    """Exponential map: the rotation by ``|w|`` radians about ``w``.

    ``(cos(|w| / 2), w sin(|w| / 2) / |w|)``, smooth everywhere, zero included.
    """
    theta_sq = w @ w
    return jnp.concatenate([cos_half(theta_sq)[None], sinc_half(theta_sq) * w])


def quat_log(q: Float[Array, "4"]) -> Float[Array, "3"]:
    """Rotation vector of a quaternion, the short way round: its length is at most pi.

    ``w = 2 atan2(|u|, |q_w|) u sign(q_w) / |u|``, so that ``q`` and ``-q`` have the same
    logarithm and ``quat_exp(quat_log(q))`` is ``q`` or ``-q``. The result does not depend on
    the norm of ``q``. At exactly half a turn the answer is ``pi u``, and the derivative is the
    one-sided derivative from ``q_w > 0``. The zero quaternion has logarithm zero.

    Args:
        q: a quaternion, not necessarily of unit norm.

    Returns:
        The rotation vector in radians, whose components are equal in both frames.
    """
    q = jnp.where(q[0] < 0, -q, q)
    u_sq, w = q[1:] @ q[1:], q[0]
    small = u_sq <= _SMALL_TANGENT_SQ * w * w
    safe_w = jnp.where(small & (w > 0), w, 1.0)
    tangent_sq = jnp.where(small, u_sq, 0.0) / (safe_w * safe_w)
    length = jnp.sqrt(jnp.where(small, 1.0, u_sq))
    closed = jnp.arctan2(length, w) / length
    return 2 * jnp.where(small, horner(_ARCTANGENT, tangent_sq) / safe_w, closed) * q[1:]


def quat_from_axis_angle(axis: Float[Array, "3"], angle: Float[Array, ""]) -> Float[Array, "4"]:
    """Rotation by ``angle`` radians about ``axis``, which must have unit length."""
    return jnp.concatenate([jnp.cos(angle / 2)[None], jnp.sin(angle / 2) * axis])


def quat_integrate(
    q: Float[Array, "4"], w: Float[Array, "3"], dt: Float[Array, ""] | float
) -> Float[Array, "4"]:
    """Turn at a constant angular velocity for a time: ``normalize(q) exp(w dt)``.

    Args:
        q: orientation ``q_WB``; normalised first, as in MuJoCo's ``mju_quatIntegrate``.
        w: angular velocity in rad/s, in the axes of B.
        dt: time in seconds.

    Returns:
        The orientation ``q_WB`` afterwards.
    """
    return quat_mul(quat_normalize(q), quat_exp(w * dt))


def quat_difference(a: Float[Array, "4"], b: Float[Array, "4"]) -> Float[Array, "3"]:
    """Rotation vector from ``a`` to ``b`` in the axes of ``a``: ``a exp(w) = b``, ``|w| <= pi``.

    Equal to MuJoCo's ``mju_subQuat(res, b, a)``; note the order.
    """
    return quat_log(quat_mul(quat_conj(a), b))


def quat_to_matrix(q: Float[Array, "4"]) -> Float[Array, "3 3"]:
    """Rotation matrix ``R_AB`` of ``q_AB``, with ``v_A = R_AB v_B``."""
    w, x, y, z = q
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    rows = [
        [ww + xx - yy - zz, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), ww - xx + yy - zz, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), ww - xx - yy + zz],
    ]
    # Row by row: XLA fuses a concatenation of three rows, but not one of nine entries.
    return jnp.stack([jnp.stack(row) for row in rows])


def quat_from_matrix(R: Float[Array, "3 3"]) -> Float[Array, "4"]:
    """Quaternion of a rotation matrix, with ``q_w >= 0``.

    Each row of ``4 q q^T`` is linear in the entries of the matrix; the row with the largest
    diagonal entry, which is at least one, is normalised (Shepperd's method).

    Raises:
        ValueError: the shape is not (3, 3).
    """
    if np.shape(R) != (3, 3):
        raise ValueError(f"a rotation matrix has shape (3, 3), not {np.shape(R)}")
    rows = _outer_product_rows(jnp.asarray(R))
    row, largest = rows[0], rows[0][0]
    for i in (1, 2, 3):
        better = rows[i][i] > largest
        row = jnp.where(better, rows[i], row)
        largest = jnp.where(better, rows[i][i], largest)
    return quat_normalize(jnp.where(row[0] < 0, -row, row))


def _outer_product_rows(R):
    """The four rows of ``4 q q^T`` for the rotation matrix of ``q``."""
    (a, b, c), (d, e, f), (g, h, i) = R
    return [
        jnp.stack([1 + a + e + i, h - f, c - g, d - b]),
        jnp.stack([h - f, 1 + a - e - i, b + d, c + g]),
        jnp.stack([c - g, b + d, 1 - a + e - i, f + h]),
        jnp.stack([d - b, c + g, f + h, 1 - a - e + i]),
    ]
