"""The recursive Newton-Euler algorithm: inverse dynamics in O(n).

Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3. In world axes about one point no
transformations are needed: velocities and accelerations are running sums from the roots outward,
forces are sums from the leaves inward.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.arrays.precision import full_precision
from jaxsim.dynamics.free_bodies import free_dofs, free_links, replace_rows
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia, tendon_bias, tendon_inertia
from jaxsim.dynamics.tree import accumulate_inward, accumulate_outward
from jaxsim.dynamics.velocity import Velocities, velocities
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order, to_tree_order
from jaxsim.model.inputs import admit_array, admit_model
from jaxsim.model.topology import Forest
from jaxsim.spatial import Inertia, cross_force, quat_to_matrix, wrench_from

_GRAVITY_OFF = mujoco.mjtDisableBit.mjDSBL_GRAVITY


@full_precision
def inverse_dynamics(
    model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"], qacc: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """Generalised forces that produce a motion without constraints, `M qacc + qfrc_bias`.

    Args:
      model: the model.
      qpos: coordinates.
      qvel: velocities.
      qacc: accelerations.

    Returns:
      Forces in N or N m; `forward_dynamics` inverts this.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, qpos = admit_model(model), admit_array(model, qpos, (model.nq,), "qpos")
    qvel = admit_array(model, qvel, (model.nv,), "qvel")
    qacc = admit_array(model, qacc, (model.nv,), "qacc")
    kin = kinematics(model, qpos)
    return inertial_force(model, kin, velocities(model, kin, qvel), qacc)


def inertial_force(
    model: Model, kin: Kinematics, vel: Velocities, qacc: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """`M qacc + qfrc_bias`."""
    force = link_forces(model, kin, vel, link_accelerations(model, kin, vel, qacc))
    total = generalized_force(model, kin, force) + dof_armature(model) * qacc
    if not has_tendon_inertia(model):
        return total
    return total + tendon_inertia(model, kin) @ qacc + tendon_bias(model, kin, vel)


def qfrc_bias(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv"]:
    """Coriolis, centrifugal and gravity forces: `M qacc + qfrc_bias` is the sum of all others."""
    total = link_bias(model, kin, vel)
    return total + tendon_bias(model, kin, vel) if has_tendon_inertia(model) else total


def link_bias(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv"]:
    """`qfrc_bias` of the links alone, without tendons' armature."""
    wrench, force = bias_forces(model, kin, vel)
    return generalized_force(model, kin, wrench) + force


def bias_forces(
    model: Model, kin: Kinematics, vel: Velocities
) -> tuple[Float[Array, "njnt 6"], Float[Array, "nv"] | float]:
    """`link_bias` in two parts.

    Returns:
      The wrenches on the links, zero for lone free bodies, and the generalised forces of these
      (0.0 without such bodies).
    """
    wrench = link_forces(model, kin, vel, link_accelerations(model, kin, vel))
    links = free_links(model)
    if not len(links):
        return wrench, 0.0
    force = _free_bias(model, kin, vel).reshape(-1)
    wrench = replace_rows(wrench, links, jnp.zeros((len(links), 6), wrench.dtype))
    nothing = jnp.zeros(model.nv, force.dtype)
    return wrench, replace_rows(nothing, free_dofs(model).ravel(), force)


def _free_bias(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "n 6"]:
    """Bias of lone free bodies: forces in world axes, torques in the axes of the body.

    For a body of mass m, first moment h and inertia I about its origin they are
    `w x (w x h) - m g` and `w x (I w) - h x g`. As `w x w = 0`, a multiple of 1 is taken from I:
    with the middle moment, a rod has no torque about its axis from what rounding leaves of others.
    """
    g, links = gravity(model), free_links(model)

    def one(quat, inertia: Inertia, twist):
        R, w, h = quat_to_matrix(quat), twist[:3], inertia.first_moment
        x, y, z = jnp.diagonal(inertia.rotational)
        middle = jnp.maximum(jnp.minimum(x, y), jnp.minimum(jnp.maximum(x, y), z))
        spread = inertia.rotational - middle * jnp.eye(3, dtype=w.dtype)
        torque = jnp.cross(w, spread @ w) - jnp.cross(h, g @ R)
        return jnp.concatenate([R @ jnp.cross(w, jnp.cross(w, h)) - inertia.mass * g, torque])

    quat, inertia = jax.tree.map(lambda x: take(x, links), (kin.link_pose.quat, kin.link_inertia))
    return jax.vmap(one)(quat, inertia, vel.free)


def gravity(model: Model) -> Float[Array, "3"]:
    """Gravitational acceleration (m/s^2); zero if the model disables gravity."""
    return model.opt.gravity * (0.0 if model.opt.disabled(_GRAVITY_OFF) else 1.0)


def link_accelerations(
    model: Model, kin: Kinematics, vel: Velocities, qacc: Float[Array, "nv"] | None = None
) -> Float[Array, "njnt 6"]:
    """Accelerations of the links minus gravity: a link at rest has acceleration `-gravity`.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its velocities.
      qacc: accelerations of the degrees of freedom; None for zero.
    """
    total = vel.bias
    if qacc is not None:
        tree = model.tree
        each = kin.cdof * to_tree_order(model, qacc)[:, None]
        total = total + accumulate_outward(tree, sum_by(each, tree.dof_node, len(tree)))
    lift = jnp.concatenate([jnp.zeros(3, total.dtype), -gravity(model)])
    return total + lift[None]


def link_forces(
    model: Model, kin: Kinematics, vel: Velocities, acceleration: Float[Array, "njnt 6"]
) -> Float[Array, "njnt 6"]:
    """Total wrench on each link by the Newton-Euler equation, `F = G a + v x* (G v)`."""

    def one(inertia: Inertia, v, a):
        return inertia.apply(a) + cross_force(v, inertia.apply(v))

    return jax.vmap(one)(kin.inertia, vel.cvel, acceleration)


def generalized_force(
    model: Model, kin: Kinematics, link_wrench: Float[Array, "njnt 6"]
) -> Float[Array, "nv"]:
    """Generalised forces `J^T F` of wrenches on the links.

    Args:
      model: the model.
      kin: its kinematics.
      link_wrench: wrenches about the tree's reference point, tree order.
    """
    return from_tree_order(model, tree_force(model.tree, kin.cdof, link_wrench))


def tree_force(
    tree: Forest, cdof: Float[Array, "nv k"], link_wrench: Float[Array, "njnt k"]
) -> Float[Array, "nv"]:
    """`generalized_force` in tree order, for wrenches with k components."""
    total = accumulate_inward(tree, link_wrench)
    return (cdof * take(total, tree.dof_node)).sum(1)


def project_wrench(
    model: Model,
    kin: Kinematics,
    wrench: Float[Array, "n 6"],
    point: Float[Array, "n 3"],
    bodies: np.ndarray | None = None,
) -> Float[Array, "nv"]:
    """Generalised forces of wrenches on bodies.

    Args:
      model: the model.
      kin: its kinematics.
      wrench: (torque, force) on each body, world axes.
      point: point of action on each body, world coordinates (m).
      bodies: (n,) bodies, which may repeat; None for all.
    """
    return generalized_force(model, kin, wrench_on_links(model, kin, wrench, point, bodies))


def wrench_on_links(
    model: Model, kin: Kinematics, wrench, point, bodies: np.ndarray | None = None
) -> Float[Array, "njnt 6"]:
    """Wrenches on links about the trees' reference points, from wrenches on bodies."""
    link = model.body_link if bodies is None else model.body_link[bodies]
    (moving,) = (link >= 0).nonzero()
    link = link[moving]
    arm = take(point, moving) - take(take(kin.origin, model.tree.root), link)
    moved = jax.vmap(wrench_from)(take(wrench, moving), arm)
    return sum_by(moved, link, len(model.tree))
