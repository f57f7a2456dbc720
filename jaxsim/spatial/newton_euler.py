"""The Newton-Euler equation of one rigid body, in its own frame.

``F = G dV - ad(V)^T G V``: the wrench on a body is the rate of its momentum ``G V``, which is
measured in a frame that moves with twist ``V``. Written out at the centre of mass it is
``torque = I dw + w x I w`` and ``force = m (dv + w x v)``.
"""

from jaxtyping import Array, Float

from jaxsim.spatial.inertia import Inertia
from jaxsim.spatial.twist import cross_force


def newton_euler_wrench(
    inertia: Inertia, V: Float[Array, "6"], dV: Float[Array, "6"]
) -> Float[Array, "6"]:
    """Wrench that produces a motion, ``F = G dV - ad(V)^T G V`` (Lynch and Park, eq. 8.40).

    Args:
        inertia: ``G`` in the body's frame.
        V: body twist.
        dV: derivative of the components of the body twist with respect to time.

    Returns:
        The wrench ``(torque, force)`` in the body's frame (N m, N).
    """
    return inertia.apply(dV) + cross_force(V, inertia.apply(V))


def newton_euler_acceleration(
    inertia: Inertia, V: Float[Array, "6"], F: Float[Array, "6"]
) -> Float[Array, "6"]:
    """Acceleration that a wrench causes, ``dV = G^-1 (F + ad(V)^T G V)``.

    Inverts :func:`newton_euler_wrench`; the inertia must be positive definite.
    """
    return inertia.solve(F - cross_force(V, inertia.apply(V)))
