"""Forward kinematics: poses of links, bodies, geoms and sites, and motion axes of the joints."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.dynamics.links import Links, link_parameters
from jaxsim.dynamics.tendons.fixed import fixed_length
from jaxsim.dynamics.tendons.path import spatial_tendons
from jaxsim.dynamics.tendons.spatial import spatial_paths
from jaxsim.dynamics.tree import accumulate_inward, outward
from jaxsim.joints.grouping import per_joint, position_rows
from jaxsim.model import Model
from jaxsim.model.topology import Forest
from jaxsim.spatial import Inertia, Pose, quat_normalize, quat_to_matrix


@struct.dataclass
class Kinematics:
    """Poses in world coordinates; names, shapes and order are MuJoCo's unless said otherwise.

    `spatial_J` has the rows of MuJoCo's `ten_J` for spatial tendons only. The fields after it are
    for the recursions: links and degrees of freedom are in tree order; twists and inertias are in
    world axes about `origin`, the reference point of each tree. It is the origin of the tree's
    first body, which keeps float32 accurate far from the world's origin. `link_inertia` is in the
    axes of each link about its origin.
    """

    xpos: Float[Array, "nbody 3"]
    xquat: Float[Array, "nbody 4"]
    xmat: Float[Array, "nbody 3 3"]
    xipos: Float[Array, "nbody 3"]
    ximat: Float[Array, "nbody 3 3"]
    geom_xpos: Float[Array, "ngeom 3"]
    geom_xmat: Float[Array, "ngeom 3 3"]
    site_xpos: Float[Array, "nsite 3"]
    site_xmat: Float[Array, "nsite 3 3"]
    subtree_com: Float[Array, "nbody 3"]
    ten_length: Float[Array, "ntendon"]

    spatial_J: Float[Array, "nspatial nv"]
    origin: Float[Array, "ntree 3"]
    link_pose: Pose
    cdof: Float[Array, "nv 6"]
    inertia: Inertia
    link_inertia: Inertia


def kinematics(
    model: Model,
    qpos: Float[Array, "nq"],
    mocap_pos: Float[Array, "nmocap 3"] | None = None,
    mocap_quat: Float[Array, "nmocap 4"] | None = None,
    links: Links | None = None,
) -> Kinematics:
    """Poses of bodies, geoms and sites, lengths of tendons, motion axes and link inertias.

    Args:
      model: the model.
      qpos: coordinates; quaternions need not be normalised.
      mocap_pos: positions of the mocap bodies; None for those of the model.
      mocap_quat: orientations of the mocap bodies.
      links: `link_parameters(model)`, if already computed.
    """
    links = link_parameters(model) if links is None else links
    base = _base_poses(model, mocap_pos, mocap_quat)
    pose = _link_poses(model, links, qpos, base)
    body = _body_poses(model, links, pose, base)
    xmat = jax.vmap(quat_to_matrix)(body.quat)
    xipos, ximat = _attached(
        body.pos, xmat, np.arange(model.nbody), model.body_ipos, model.body_iquat
    )
    geoms = _attached(body.pos, xmat, model.geom_bodyid, model.geom_pos, model.geom_quat)
    sites = _attached(body.pos, xmat, model.site_bodyid, model.site_pos, model.site_quat)
    origin = take(pose.pos, reference_links(model))
    # The roots are static, so this is a broadcast for one tree and a gather for several.
    relative = pose.pos - take(origin, model.tree.root)
    mat = jax.vmap(quat_to_matrix)(pose.quat)
    poses = Kinematics(
        xpos=body.pos,
        xquat=body.quat,
        xmat=xmat,
        xipos=xipos,
        ximat=ximat,
        geom_xpos=geoms[0],
        geom_xmat=geoms[1],
        site_xpos=sites[0],
        site_xmat=sites[1],
        subtree_com=_subtree_com(model, xipos),
        ten_length=fixed_length(model, qpos),
        spatial_J=jnp.zeros((0, model.nv), qpos.dtype),
        origin=origin,
        link_pose=pose,
        cdof=_motion_axes(model.tree, links, mat, relative),
        inertia=jax.vmap(_world_inertia)(links.inertia, mat, relative),
        link_inertia=links.inertia,
    )
    if not len(spatial_tendons(model)):
        return poses
    length, jacobian = spatial_paths(model, poses)
    return poses.replace(ten_length=poses.ten_length + length, spatial_J=jacobian)


def reference_links(model: Model) -> np.ndarray:
    """(ntree,) link of each tree's first body, whose origin is the tree's reference point."""
    tree = model.tree
    body = model.jnt_bodyid[tree.order[: tree.nroot]]
    return tree.position[model.body_jntadr[body] + model.body_jntnum[body] - 1]


def _base_poses(model: Model, mocap_pos, mocap_quat) -> Pose:
    """(1 + nmocap,) poses of the world and the mocap bodies, which no joint moves."""
    world = Pose.identity(model.body_pos.dtype)
    base = jax.tree.map(lambda a: a[None], world)
    if model.nmocap == 0:
        return base
    if mocap_pos is None or mocap_quat is None:
        bodies = model.structure.mocap_bodies
        mocap_pos, mocap_quat = model.body_pos[bodies], model.body_quat[bodies]
    mocap = Pose(quat=jax.vmap(quat_normalize)(mocap_quat), pos=mocap_pos)
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), base, mocap)


def _base_index(model: Model, bodies: np.ndarray) -> np.ndarray:
    """Index into `_base_poses` of the carrier of each of some bodies that no joint moves."""
    return model.body_mocapid[model.structure.body_carrier[bodies]] + 1


def _link_poses(model: Model, links: Links, qpos, base: Pose) -> Pose:
    """World poses of the links, composed from the roots outward."""
    tree = model.tree
    displacement = joint_poses(model, links, qpos)
    local = jax.vmap(Pose.__matmul__)(links.offset, displacement)
    below = model.body_parentid[model.jnt_bodyid[tree.order[: tree.nroot]]]
    root = jax.tree.map(lambda a: take(a, _base_index(model, below)), base)
    return outward(tree, lambda above, x, _: (above @ x, ()), root, local)[0]


def joint_poses(model: Model, links: Links, qpos) -> Pose:
    """Displacements of all joints, in tree order."""
    tree = model.tree
    q, q0 = (position_rows(model, x, tree.order) for x in (qpos, model.qpos0))
    return per_joint(
        tree.kind,
        ("pose",),
        lambda joint: joint.pose,
        *(q, q0, links.axis, links.anchor),
        empty=links.offset,
    )


def _motion_axes(tree: Forest, links: Links, mat, relative) -> Float[Array, "nv 6"]:
    """Motion axes of all degrees of freedom, in tree order."""
    return per_joint(
        tree.kind,
        ("motion_axes",),
        lambda joint: joint.motion_axes,
        *(mat, relative, links.axis, links.anchor),
        empty=np.zeros((0, 6), mat.dtype),
        start=tree.dof_start,
    )


def _body_poses(model: Model, links: Links, pose: Pose, base: Pose) -> Pose:
    """World poses of all bodies: the pose of the carrier times the body's pose on it."""
    bodies = np.arange(model.nbody)
    link = model.body_link
    index = np.where(
        link >= 0, len(base.pos) + link, np.minimum(_base_index(model, bodies), len(base.pos) - 1)
    )
    carrier = jax.tree.map(lambda a, b: take(jnp.concatenate([a, b]), index), base, pose)
    (welded,) = np.nonzero(model.structure.body_carrier != bodies)
    if not len(welded):
        return carrier
    moved = jax.vmap(Pose.__matmul__)(
        *(jax.tree.map(lambda a: take(a, welded), x) for x in (carrier, links.body))
    )
    (rest,) = np.nonzero(model.structure.body_carrier == bodies)
    fixed = jax.tree.map(lambda a: take(a, rest), carrier)
    order = np.argsort(np.concatenate([welded, rest]))
    return jax.tree.map(lambda *a: take(jnp.concatenate(a), order), moved, fixed)


def _attached(xpos, xmat, bodies, pos, quat):
    """World positions and orientations of frames fixed to bodies."""

    def one(p, R, pos, quat):
        return p + R @ pos, R @ quat_to_matrix(quat_normalize(quat))

    return jax.vmap(one)(take(xpos, bodies), take(xmat, bodies), pos, quat)


def _subtree_com(model: Model, xipos) -> Float[Array, "nbody 3"]:
    """Centre of mass of each body's subtree; the body's `xipos` if the subtree has no mass."""
    forest = model.structure.body_tree
    mass = take(model.body_mass, forest.order)
    moment = mass[:, None] * take(xipos, forest.order)
    mass, moment = accumulate_inward(forest, (mass, moment))
    mass, moment = take(mass, forest.position), take(moment, forest.position)
    light = mass < MINVAL
    com = moment / jnp.where(light, 1.0, mass)[:, None]
    return jnp.where(light[:, None], xipos, com)


def _world_inertia(inertia: Inertia, mat, pos) -> Inertia:
    """A link's inertia in world axes about the reference point."""
    turned = inertia.replace(
        first_moment=mat @ inertia.first_moment, rotational=mat @ inertia.rotational @ mat.T
    )
    return turned.shift(pos)
