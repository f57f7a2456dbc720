"""Inertias, velocities, accelerations and forces of all bodies, in MuJoCo's com-based convention.

Everything here is in world axes about the centre of mass of the body's kinematic tree, that is
about `subtree_com[body_rootid[i]]`, with the angular part first. Gymnasium's observations
(`cinert`, `cvel`, `cfrc_ext`) and the acceleration sensors read these.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import gravity, link_accelerations
from jaxsim.dynamics.tree import accumulate_inward
from jaxsim.dynamics.velocity import Velocities, body_twists
from jaxsim.model import Model
from jaxsim.spatial import Inertia, cross_force, wrench_from


def tree_com(model: Model, kin: Kinematics) -> Float[Array, "nbody 3"]:
    """Reference point of each body's com-based quantities, its tree's centre of mass (m)."""
    return take(kin.subtree_com, model.body_rootid)


def body_inertias(model: Model, kin: Kinematics) -> Inertia:
    """Inertias of all bodies about `tree_com`; zero for the world."""

    def one(mass, offset, moments, R):
        return Inertia.from_com(mass, offset, (R * moments[None]) @ R.T)

    offset = kin.xipos - tree_com(model, kin)
    inertia = jax.vmap(one)(model.body_mass, offset, model.body_inertia, kin.ximat)
    return jax.tree.map(lambda a: jnp.concatenate([jnp.zeros_like(a[:1]), a[1:]]), inertia)


def cinert(model: Model, kin: Kinematics) -> Float[Array, "nbody 10"]:
    """Inertias of all bodies in MuJoCo's packing.

    Args:
      model: the model.
      kin: its kinematics.

    Returns:
      For each body `(Ixx, Iyy, Izz, Ixy, Ixz, Iyz)` about `tree_com` (kg m^2), the mass times the
      position of the centre of mass from `tree_com` (kg m), and the mass (kg).
    """
    inertia = body_inertias(model, kin)
    entries = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    packed = jnp.stack([inertia.rotational[:, i, j] for i, j in entries], axis=1)
    return jnp.concatenate([packed, inertia.first_moment, inertia.mass[:, None]], axis=1)


def crb(model: Model, kin: Kinematics) -> Float[Array, "nbody 10"]:
    """Inertias of the subtrees of all bodies, packed as in `cinert`; zero for the world."""
    forest = model.structure.body_tree
    total = accumulate_inward(forest, take(cinert(model, kin), forest.order))
    return take(total, forest.position).at[0].set(0)


def cvel(model: Model, kin: Kinematics, vel: Velocities) -> Float[Array, "nbody 6"]:
    """Twists of all bodies about `tree_com`: `(omega, v)` in rad/s and m/s."""
    return body_twists(model, kin, vel.cvel, tree_com(model, kin))


def cacc(
    model: Model, kin: Kinematics, vel: Velocities, qacc: Float[Array, "nv"]
) -> Float[Array, "nbody 6"]:
    """Spatial accelerations of all bodies minus gravity, about `tree_com`.

    Bodies at rest, such as the world, have `(0, -g)`.

    Args:
      model: the model.
      kin: its kinematics.
      vel: its velocities.
      qacc: accelerations of the degrees of freedom.

    Returns:
      `(alpha, a)` in rad/s^2 and m/s^2; `a` is the rate of the velocity at the point `tree_com`,
      taken as fixed in space, not the acceleration of a point of the body.
    """
    links = link_accelerations(model, kin, vel, qacc)
    moving = body_twists(model, kin, links, tree_com(model, kin))
    at_rest = jnp.concatenate([jnp.zeros(3, moving.dtype), -gravity(model)])[None]
    static = jnp.asarray(model.body_link < 0)[:, None]
    return jnp.where(static, at_rest, moving)


def cfrc_ext(
    model: Model, kin: Kinematics, wrench: Float[Array, "nbody 6"]
) -> Float[Array, "nbody 6"]:
    """External wrenches about `tree_com`, zero for the world.

    Args:
      model: the model.
      kin: its kinematics.
      wrench: (torque, force) on each body, the torque about its centre of mass `xipos`, as
        `external_wrench` returns it.
    """
    arm = kin.xipos - tree_com(model, kin)
    moved = jax.vmap(wrench_from)(wrench, arm)
    return jnp.concatenate([jnp.zeros_like(moved[:1]), moved[1:]])


def cfrc_int(
    model: Model,
    inertia: Inertia,
    cvel: Float[Array, "nbody 6"],
    cacc: Float[Array, "nbody 6"],
    cfrc_ext: Float[Array, "nbody 6"],
) -> Float[Array, "nbody 6"]:
    """Wrenches that bodies receive from their parents, about `tree_com`.

    By the Newton-Euler equation it is the rate of momentum of the subtree minus the external
    wrenches on it (Featherstone 2008, eq. 5.20). It includes the forces along the joint's degrees
    of freedom, from actuators, springs and limits.

    Args:
      model: the model.
      inertia: `body_inertias`.
      cvel: twists of all bodies.
      cacc: accelerations of all bodies.
      cfrc_ext: external wrenches on all bodies.
    """

    def one(G: Inertia, v, a, external):
        return G.apply(a) + cross_force(v, G.apply(v)) - external

    forest = model.structure.body_tree
    each = jax.vmap(one)(inertia, cvel, cacc, cfrc_ext)
    return take(accumulate_inward(forest, take(each, forest.order)), forest.position)
