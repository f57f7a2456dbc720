"""Twists and wrenches: changes of frame, cross products and power.

A twist ``V = (omega, v)`` is the velocity of a body; a wrench ``F = (torque, force)`` acts on
it. Both refer to a frame: ``v`` is the velocity of the point of the body that is at the
frame's origin, and the torque is about that origin. The *body* twist of B refers to B itself,
the *spatial* twist refers to the frame in which B moves.

Example: a body turns at 1 rad/s about z while its origin moves at 0.5 m/s along the world's x.
Its position is (2, 0, 0), and it is rotated by 90 degrees about z, so it moves along its own -y:

>>> import jax.numpy as jnp
>>> from jaxsim.spatial import Pose, adjoint, quat_from_axis_angle
>>> quarter = quat_from_axis_angle(jnp.array([0.0, 0.0, 1.0]), jnp.asarray(jnp.pi / 2))
>>> X_WB = Pose(quat=quarter, pos=jnp.array([2.0, 0.0, 0.0]))
>>> V_body = jnp.array([0.0, 0.0, 1.0, 0.0, -0.5, 0.0])
>>> V_spatial = adjoint(X_WB) @ V_body
>>> [round(float(x), 4) + 0.0 for x in V_spatial]
[0.0, 0.0, 1.0, 0.5, -2.0, 0.0]

The body's point at the world's origin moves at ``0.5 x - omega x (2 x) = 0.5 x - 2 y``.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.spatial.pose import Pose
from jaxsim.spatial.quaternion import quat_inv_rotate, quat_rotate, quat_to_matrix
from jaxsim.spatial.so3 import skew


def adjoint(X: Pose) -> Float[Array, "6 6"]:
    """Ad of a pose, ``[[R, 0], [p x R, R]]``; from ``X_AB`` it maps twists in B to twists in A."""
    R = quat_to_matrix(X.quat)
    return _blocks(R, jnp.zeros_like(R), skew(X.pos) @ R, R)


def coadjoint(X: Pose) -> Float[Array, "6 6"]:
    """Inverse transpose of Ad, ``[[R, p x R], [0, R]]``: wrenches from B to A.

    ``F_A = coadjoint(X_AB) F_B`` keeps the power: ``V_A . F_A = V_B . F_B``.
    """
    R = quat_to_matrix(X.quat)
    return _blocks(R, skew(X.pos) @ R, jnp.zeros_like(R), R)


def ad(V: Float[Array, "6"]) -> Float[Array, "6 6"]:
    """Derivative of Ad at the identity along a twist, ``[[omega x, 0], [v x, omega x]]``."""
    w, v = skew(V[:3]), skew(V[3:])
    return _blocks(w, jnp.zeros_like(w), v, w)


def spatial_twist(X: Pose, V_body: Float[Array, "6"]) -> Float[Array, "6"]:
    """Twist in frame A from the twist in frame B: ``adjoint(X_AB) @ V_body`` without the matrix."""
    w, v = quat_rotate(X.quat, V_body[:3]), quat_rotate(X.quat, V_body[3:])
    return jnp.concatenate([w, v + jnp.cross(X.pos, w)])


def body_twist(X: Pose, V_spatial: Float[Array, "6"]) -> Float[Array, "6"]:
    """Twist in frame B from the twist in frame A; inverts :func:`spatial_twist`."""
    w, v = V_spatial[:3], V_spatial[3:]
    at_origin = v + jnp.cross(w, X.pos)
    return jnp.concatenate([quat_inv_rotate(X.quat, w), quat_inv_rotate(X.quat, at_origin)])


def spatial_wrench(X: Pose, F_body: Float[Array, "6"]) -> Float[Array, "6"]:
    """Wrench in frame A from the wrench in frame B: ``coadjoint(X_AB) @ F_body``."""
    torque, force = quat_rotate(X.quat, F_body[:3]), quat_rotate(X.quat, F_body[3:])
    return jnp.concatenate([torque + jnp.cross(X.pos, force), force])


def body_wrench(X: Pose, F_spatial: Float[Array, "6"]) -> Float[Array, "6"]:
    """Wrench in frame B from the wrench in frame A; inverts :func:`spatial_wrench`."""
    torque, force = F_spatial[:3], F_spatial[3:]
    at_origin = torque - jnp.cross(X.pos, force)
    return jnp.concatenate([quat_inv_rotate(X.quat, at_origin), quat_inv_rotate(X.quat, force)])


def twist_at(V: Float[Array, "6"], arm: Float[Array, "3"]) -> Float[Array, "6"]:
    """The twist about another point, ``(w, v + w x arm)``; ``arm`` leads to the new point."""
    w, v = V[:3], V[3:]
    return jnp.concatenate([w, v + jnp.cross(w, arm)])


def wrench_from(F: Float[Array, "6"], arm: Float[Array, "3"]) -> Float[Array, "6"]:
    """The wrench about another point, ``(torque + arm x force, force)``.

    ``arm`` leads from the new point to the old one; the transpose of :func:`twist_at`.
    """
    torque, force = F[:3], F[3:]
    return jnp.concatenate([torque + jnp.cross(arm, force), force])


def acceleration_at(
    A: Float[Array, "6"], V: Float[Array, "6"], arm: Float[Array, "3"]
) -> Float[Array, "6"]:
    """Angular acceleration of a body and linear acceleration of one of its points.

    ``(dw, a + dw x arm + w x v_point)``. The linear part of ``A`` is the rate of the velocity at a
    point fixed in space, which differs by ``w x v`` from the acceleration of the body's point there
    (Featherstone 2008, section 2.11).

    Args:
        A: spatial acceleration, the rate ``(dw, a)`` of the twist ``V``.
        V: twist.
        arm: position of the point from the one that ``A`` and ``V`` are about (m).

    Returns:
        The angular (rad/s^2) and the linear acceleration (m/s^2).
    """
    moved, velocity = twist_at(A, arm), twist_at(V, arm)
    return jnp.concatenate([moved[:3], moved[3:] + jnp.cross(V[:3], velocity[3:])])


def cross_motion(V: Float[Array, "6"], W: Float[Array, "6"]) -> Float[Array, "6"]:
    """``ad(V) @ W``: rate of a twist ``W`` that is fixed in a body with twist ``V``.

    Featherstone's ``V x W`` (Rigid Body Dynamics Algorithms, eq. 2.31).
    """
    w, v = V[:3], V[3:]
    return jnp.concatenate([jnp.cross(w, W[:3]), jnp.cross(v, W[:3]) + jnp.cross(w, W[3:])])


def cross_force(V: Float[Array, "6"], F: Float[Array, "6"]) -> Float[Array, "6"]:
    """``-ad(V).T @ F``: rate of a wrench or momentum ``F`` fixed in a body with twist ``V``.

    Featherstone's ``V x* F`` (Rigid Body Dynamics Algorithms, eq. 2.32).
    """
    w, v = V[:3], V[3:]
    return jnp.concatenate([jnp.cross(w, F[:3]) + jnp.cross(v, F[3:]), jnp.cross(w, F[3:])])


def power(V: Float[Array, "6"], F: Float[Array, "6"]) -> Float[Array, ""]:
    """Power in watts of a wrench on a body with a twist, both in one frame: ``V . F``."""
    return V @ F


def _blocks(top_left, top_right, bottom_left, bottom_right):
    """A 6x6 matrix from four 3x3 blocks."""
    top = jnp.concatenate([top_left, top_right], axis=1)
    return jnp.concatenate([top, jnp.concatenate([bottom_left, bottom_right], axis=1)])
