"""Rotations, poses, twists, wrenches and inertias of single rigid bodies.

Everything here is for one element, without batch axes; ``jax.vmap`` supplies them. The
conventions below hold in the whole package.

**Quaternions** are ``(w, x, y, z)``, as in MuJoCo, with Hamilton's product (``i j = k``). They
act on column vectors from the left: ``quat_rotate(q, v)`` is ``q v q*``. ``q`` and ``-q`` are the
same rotation; logarithms and differences go the short way round.

**Frames** are written as in Drake, so that a mistake shows as letters that do not cancel.
W is the world and B a body.

=============  ==================================================================================
``R_AB``       rotation matrix, ``v_A = R_AB v_B``; ``q_AB`` is its quaternion
``p_AB``       position of B's origin from A's origin, in the axes of A; ``p_AB_C`` in axes of C
``X_AB``       pose of B in A, the pair ``(q_AB, p_AB)``; ``X_AC = X_AB @ X_BC``
``V_WB_B``     twist of B in W: body twist, in the axes of B and about B's origin
``V_WB_W``     twist of B in W: spatial twist, in the axes of W and about W's origin
``F_B``        wrench in the axes of B, with torque about B's origin
``G_B``        spatial inertia in the axes of B and about B's origin
=============  ==================================================================================

Rotations are active and passive at once: ``q_AB`` turns A's axes onto B's, and it turns
components in B into components in A. A rotation vector has the same components in both.

**Spatial vectors** have the angular part first: a twist is ``(omega, v)``, a wrench
``(torque, force)``, a momentum ``(angular, linear)``. Twists change frame by ``adjoint(X_AB)``,
wrenches by ``coadjoint(X_AB)``, its inverse transpose; their product, the power, does not
change. The linear part ``v`` belongs to the point of the body at the frame's origin, which
is not the centre of mass. MuJoCo's ``qvel`` of a free joint is something else again: linear
first, the velocity of B's origin in the axes of W, then ``omega`` in the axes of B.

**Velocities** are those of the components: ``dX_WB/dt = X_WB V_WB_B`` (as matrices), and
``q_WB exp(omega dt)`` is the orientation after turning with body rate ``omega``.

**Units** are SI, angles in radians. **Precision** is that of the arguments: constants follow
the dtype of the inputs, float32 or float64. **Singular points**, which are the zero rotation,
half a turn and the zero quaternion, have finite values and derivatives in both modes.
"""

from jaxsim.spatial.inertia import Inertia
from jaxsim.spatial.newton_euler import newton_euler_acceleration, newton_euler_wrench
from jaxsim.spatial.pose import Pose, se3_exp, se3_log
from jaxsim.spatial.quaternion import (
    quat_conj,
    quat_difference,
    quat_exp,
    quat_from_axis_angle,
    quat_from_matrix,
    quat_integrate,
    quat_inv_rotate,
    quat_log,
    quat_mul,
    quat_normalize,
    quat_rotate,
    quat_to_matrix,
)
from jaxsim.spatial.so3 import skew, so3_exp, so3_log, unskew
from jaxsim.spatial.twist import (
    acceleration_at,
    ad,
    adjoint,
    body_twist,
    body_wrench,
    coadjoint,
    cross_force,
    cross_motion,
    power,
    spatial_twist,
    spatial_wrench,
    twist_at,
    wrench_from,
)

__all__ = [
    "Inertia",
    "Pose",
    "acceleration_at",
    "ad",
    "adjoint",
    "body_twist",
    "body_wrench",
    "coadjoint",
    "cross_force",
    "cross_motion",
    "newton_euler_acceleration",
    "newton_euler_wrench",
    "power",
    "quat_conj",
    "quat_difference",
    "quat_exp",
    "quat_from_axis_angle",
    "quat_from_matrix",
    "quat_integrate",
    "quat_inv_rotate",
    "quat_log",
    "quat_mul",
    "quat_normalize",
    "quat_rotate",
    "quat_to_matrix",
    "se3_exp",
    "se3_log",
    "skew",
    "so3_exp",
    "so3_log",
    "spatial_twist",
    "spatial_wrench",
    "twist_at",
    "unskew",
    "wrench_from",
]
