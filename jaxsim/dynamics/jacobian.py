"""Jacobians of points and frames, and the products of their time derivatives with `qvel`.

`jacp` and `jacr` map `qvel` to the velocity of a point and to the angular velocity of a body,
in world axes; layout and order of the degrees of freedom are those of MuJoCo's `mj_jac`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.velocity import Velocities
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order
from jaxsim.spatial import acceleration_at, twist_at


def point_jacobian(
    model: Model, kin: Kinematics, body: int, point: Float[Array, "3"]
) -> tuple[Float[Array, "3 nv"], Float[Array, "3 nv"]]:
    """Jacobian of a point that moves with a body: `v = jacp @ qvel`, `omega = jacr @ qvel`.

    Args:
      model: the model.
      kin: its kinematics.
      body: number of the body, static.
      point: position of the point, world coordinates (m).

    Returns:
      `(jacp, jacr)`; columns of joints that do not move the body are zero.

    Raises:
      IndexError: there is no such body.
    """
    link = model.body_link[_checked(model, "body", body)]
    if link < 0:
        zero = jnp.zeros((3, model.nv), kin.cdof.dtype)
        return zero, zero
    moves = jnp.asarray(model.tree.moves[link])
    arm = point - kin.origin[model.tree.root[link]]
    axes = jnp.where(moves[:, None], kin.cdof, 0)
    twists = from_tree_order(model, jax.vmap(twist_at, (0, None))(axes, arm))
    return twists[:, 3:].T, twists[:, :3].T


def body_jacobian(model: Model, kin: Kinematics, body: int):
    """`point_jacobian` of the origin of a body's frame."""
    body = _checked(model, "body", body)
    return point_jacobian(model, kin, body, kin.xpos[body])


def com_jacobian(model: Model, kin: Kinematics, body: int):
    """`point_jacobian` of the centre of mass of one body."""
    body = _checked(model, "body", body)
    return point_jacobian(model, kin, body, kin.xipos[body])


def geom_jacobian(model: Model, kin: Kinematics, geom: int):
    """`point_jacobian` of the centre of a geom."""
    geom = _checked(model, "geom", geom)
    return point_jacobian(model, kin, model.geom_bodyid[geom], kin.geom_xpos[geom])


def site_jacobian(model: Model, kin: Kinematics, site: int):
    """`point_jacobian` of a site."""
    site = _checked(model, "site", site)
    return point_jacobian(model, kin, model.site_bodyid[site], kin.site_xpos[site])


def body_jacobians(
    model: Model, kin: Kinematics, point: Float[Array, "nbody 3"]
) -> Float[Array, "nbody 6 nv"]:
    """Jacobians of one point on each body; rows are angular, then linear velocity.

    Args:
      model: the model.
      kin: its kinematics.
      point: position of each body's point, world coordinates (m).
    """
    tree = model.tree
    origin = from_tree_order(model, take(kin.origin, tree.root[tree.dof_node]))
    axes = from_tree_order(model, kin.cdof)
    # The last row of `moves` is for bodies without a link, whose link is -1.
    moves = jnp.asarray(tree.moves[model.body_link][:, model.structure.dof_position])

    def one(moves, point):
        twists = jax.vmap(twist_at)(axes, point[None] - origin)
        return jnp.where(moves[:, None], twists, 0).T

    return jax.vmap(one)(moves, point)


def jacobian_dot_qvel(
    model: Model, kin: Kinematics, vel: Velocities, body: int, point: Float[Array, "3"]
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """`d(jacp)/dt @ qvel` and `d(jacr)/dt @ qvel`: a body's accelerations where `qacc` is zero.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its velocities.
      body: number of the body, static.
      point: position of a point that moves with the body, world coordinates (m).

    Returns:
      Acceleration of the point (m/s^2), angular acceleration of the body (rad/s^2).

    Raises:
      IndexError: there is no such body.
    """
    link = model.body_link[_checked(model, "body", body)]
    if link < 0:
        return jnp.zeros(3, kin.cdof.dtype), jnp.zeros(3, kin.cdof.dtype)
    arm = point - kin.origin[model.tree.root[link]]
    acceleration = acceleration_at(vel.bias[link], vel.cvel[link], arm)
    return acceleration[3:], acceleration[:3]


def _checked(model: Model, kind: str, index: int) -> int:
    size = len(model.names.of(kind))
    if not 0 <= index < size:
        raise IndexError(f"the model has {size} elements of kind {kind!r}, got number {index}")
    return int(index)
