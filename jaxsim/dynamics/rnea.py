"""Recursive Newton-Euler: the forces that a motion needs, O(n).

Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3. In world axes about one point
nothing has to be transformed: velocities and accelerations are sums from the roots outward,
forces are sums from the leaves inward.
"""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.arrays.precision import full_precision
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.tree import accumulate_inward, accumulate_outward
from jaxsim.dynamics.velocity import Velocities, velocities
from jaxsim.model import Model
from jaxsim.model.dof_order import from_tree_order, to_tree_order
from jaxsim.model.inputs import admit_array, admit_model
from jaxsim.model.topology import Forest
from jaxsim.spatial import Inertia, cross_force, wrench_from

_GRAVITY_OFF = mujoco.mjtDisableBit.mjDSBL_GRAVITY


@full_precision
def inverse_dynamics(
    model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"], qacc: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """Generalised forces of a motion, `M qacc + qfrc_bias`, without constraints.

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
    vel = velocities(model, kin, qvel)
    force = link_forces(model, kin, vel, link_accelerations(model, kin, vel, qacc))
    return generalized_force(model, kin, force) + dof_armature(model) * qacc


def qfrc_bias(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nv"]:
    """Coriolis, centrifugal and gravity forces: what `M qacc` adds up to with all other forces."""
    force = link_forces(model, kin, vel, link_accelerations(model, kin, vel))
    return generalized_force(model, kin, force)


def gravity(model: Model) -> Float[Array, "3"]:
    """Acceleration of gravity, zero if the model switches it off."""
    return model.opt.gravity * (0.0 if model.opt.disabled(_GRAVITY_OFF) else 1.0)


def link_accelerations(
    model: Model, kin: Kinematics, vel: Velocities, qacc: Float[Array, "nv"] | None = None
) -> Float[Array, "njnt 6"]:
    """Accelerations of the links relative to free fall: the roots accelerate against gravity."""
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
    """Newton-Euler for each link by itself: `F = G a + v x* (G v)`."""

    def one(inertia: Inertia, v, a):
        return inertia.apply(a) + cross_force(v, inertia.apply(v))

    return jax.vmap(one)(kin.inertia, vel.cvel, acceleration)


def generalized_force(
    model: Model, kin: Kinematics, link_wrench: Float[Array, "njnt 6"]
) -> Float[Array, "nv"]:
    """What wrenches on the links do to the degrees of freedom: `J^T F`.

    Args:
      model: the model.
      kin: its kinematics.
      link_wrench: wrenches about the tree's reference point, tree order.
    """
    return from_tree_order(model, tree_force(model.tree, kin.cdof, link_wrench))


def tree_force(
    tree: Forest, cdof: Float[Array, "nv k"], link_wrench: Float[Array, "njnt k"]
) -> Float[Array, "nv"]:
    """`generalized_force` in tree order; k is 6, or 3 in a plane."""
    total = accumulate_inward(tree, link_wrench)
    return (cdof * take(total, tree.dof_node)).sum(1)


def project_wrench(
    model: Model,
    kin: Kinematics,
    wrench: Float[Array, "nbody 6"],
    point: Float[Array, "nbody 3"],
) -> Float[Array, "nv"]:
    """Generalised force of wrenches on bodies.

    Args:
      model: the model.
      kin: its kinematics.
      wrench: (torque, force) on each body, world axes.
      point: where each force acts (m).
    """
    return generalized_force(model, kin, wrench_on_links(model, kin, wrench, point))


def wrench_on_links(model: Model, kin: Kinematics, wrench, point) -> Float[Array, "njnt 6"]:
    """Sums of wrenches on bodies over the links that carry them, about the reference points."""
    (moving,) = (model.body_link >= 0).nonzero()
    link = model.body_link[moving]
    arm = take(point, moving) - take(take(kin.origin, model.tree.root), link)
    moved = jax.vmap(wrench_from)(take(wrench, moving), arm)
    return sum_by(moved, link, len(model.tree))
