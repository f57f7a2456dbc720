"""`PoseTarget`: where a site or a body should be, and how far it is from there."""

from typing import NamedTuple

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.series import cotangent_defect
from jaxsim.dynamics.jacobian import point_jacobian
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.model import Model
from jaxsim.model.inputs import admit_array
from jaxsim.spatial import quat_normalize, quat_to_matrix, skew, so3_log


@struct.dataclass
class PoseTarget:
    """Where a site, or the frame of a body, should be. Give one of the two by name.

    Attributes:
      pos: position in the world (m); None leaves it free.
      quat: orientation in the world, wxyz; None leaves it free.
      pos_weight: of the distance, in a sum of squares with other targets.
      rot_weight: of the angle; the default counts a radian as 0.3 m.
      site: name of the site.
      body: name of the body.
    """

    pos: Float[Array, "3"] | None = None
    quat: Float[Array, "4"] | None = None
    pos_weight: Float[Array, ""] | float = 1.0
    rot_weight: Float[Array, ""] | float = 0.3
    site: str | None = struct.field(pytree_node=False, default=None)
    body: str | None = struct.field(pytree_node=False, default=None)


class Miss(NamedTuple):
    """How far a frame is from its target.

    Attributes:
      residual: weighted position error, then weighted rotation vector, of those that are wanted.
      jacobian: its derivative by the velocity.
      distance: from the position (m), zero if none is wanted.
      angle: from the orientation (rad), zero if none is wanted.
    """

    residual: Float[Array, "m"]
    jacobian: Float[Array, "m nv"]
    distance: Float[Array, ""]
    angle: Float[Array, ""]


def admit_target(model: Model, target: PoseTarget) -> PoseTarget:
    """The target with arrays of the model's type.

    Raises:
      TypeError: it is something else, or its arrays are.
      ValueError: it names none or both of a site and a body, wants nothing, or has wrong shapes.
      KeyError: the model has no element with this name.
    """
    if not isinstance(target, PoseTarget):
        raise TypeError(f"a target must be a jaxsim.PoseTarget, got {type(target).__name__}")
    if (target.site is None) == (target.body is None):
        raise ValueError("a target names either a site or a body")
    if target.pos is None and target.quat is None:
        raise ValueError(f"the target for {target.site or target.body!r} has no pos and no quat")
    body_of(model, target)
    admit = {"pos": (3,), "quat": (4,)}
    given = {name: shape for name, shape in admit.items() if getattr(target, name) is not None}
    return target.replace(
        **{
            name: admit_array(model, jnp.asarray(getattr(target, name)), shape, f"target.{name}")
            for name, shape in given.items()
        }
    )


def body_of(model: Model, target: PoseTarget) -> int:
    """The body that carries the target's frame."""
    if target.body is not None:
        return model.names.id("body", target.body)
    return int(model.site_bodyid[model.names.id("site", str(target.site))])


def miss(model: Model, kin: Kinematics, target: PoseTarget) -> Miss:
    """How far the frame is from the target, for given poses.

    The orientation's error is the rotation vector `e = log(R R_target^T)`, in world axes.
    """
    body = body_of(model, target)
    pos, mat = kin.xpos[body], kin.xmat[body]
    if target.site is not None:
        site = model.names.id("site", target.site)
        pos, mat = kin.site_xpos[site], kin.site_xmat[site]
    jacp, jacr = point_jacobian(model, kin, body, pos)
    zero = jnp.zeros((), pos.dtype)
    rows, distance, angle = [], zero, zero
    if target.pos is not None:
        error = pos - target.pos
        rows.append((target.pos_weight, error, jacp))
        distance = jnp.sqrt(error @ error)
    if target.quat is not None:
        error = so3_log(mat @ quat_to_matrix(quat_normalize(target.quat)).T)
        rows.append((target.rot_weight, error, _rotation_rate(error) @ jacr))
        angle = jnp.sqrt(error @ error)
    residual = jnp.concatenate([w * e for w, e, _ in rows])
    return Miss(residual, jnp.concatenate([w * J for w, _, J in rows]), distance, angle)


def _rotation_rate(e: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """From the angular velocity to the rate of e: the inverse of the map's left Jacobian."""
    S = skew(e)
    return jnp.eye(3, dtype=e.dtype) - S / 2 + cotangent_defect(e @ e) * (S @ S)
