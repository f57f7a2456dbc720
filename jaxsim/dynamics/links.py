"""Links: what the model's bodies and joints are to the recursions.

One joint is one link. A body with three hinges is three links, the first two without mass; bodies
welded to a body belong to its link. All numbers are computed from the model's leaves, so they
follow when a user changes, vmaps or differentiates a mass or a pose.
"""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.dynamics.tree import outward
from jaxsim.joints import JOINTS
from jaxsim.model import Model
from jaxsim.spatial import Inertia, Pose, quat_normalize


@struct.dataclass
class Links:
    """Constants of the links in tree order, and where the bodies sit on them.

    Attributes:
      offset: pose of each link's joint frame in its parent link, at zero joint displacement.
      axis: joint axis in the link frame.
      anchor: joint anchor in the link frame (m).
      inertia: inertia in the link frame about the link's origin.
      body: pose of every body in the frame of the link, mocap body or world that carries it.
    """

    offset: Pose
    axis: Float[Array, "njnt 3"]
    anchor: Float[Array, "njnt 3"]
    inertia: Inertia
    body: Pose


def link_parameters(model: Model) -> Links:
    """Merge the model's bodies into links."""
    body = _poses_on_carrier(model)
    joints = model.tree.order
    return Links(
        offset=_offsets(model, body),
        axis=take(model.jnt_axis, joints),
        anchor=take(model.jnt_pos, joints),
        inertia=_merged_inertia(model, body),
        body=body,
    )


def _poses_on_carrier(model: Model) -> Pose:
    """(nbody,) poses; the identity for the world and for bodies with joints or mocap."""
    forest = model.weld_tree
    is_carrier = forest.parent < 0
    local = _local_poses(model, forest.order, is_carrier)
    root = _identities(forest.nroot, local.pos.dtype)
    stacked, _ = outward(forest, lambda above, pose, _: (above @ pose, ()), root, local)
    return jax.tree.map(lambda a: take(a, forest.position), stacked)


def _local_poses(model: Model, bodies: np.ndarray, identity: np.ndarray) -> Pose:
    """Poses of bodies in their parents, the identity where a static mask says so."""
    none = _identities(len(bodies), model.body_pos.dtype)
    quat = jax.vmap(quat_normalize)(take(model.body_quat, bodies))
    mask = identity[:, None]
    return Pose(
        quat=jnp.where(mask, none.quat, quat),
        pos=jnp.where(mask, none.pos, take(model.body_pos, bodies)),
    )


def _offsets(model: Model, body: Pose) -> Pose:
    """Where the first joint of a body sits on the parent's link; identity for further joints.

    A joint that places its body in the world does so whatever the model says about its parent.
    """
    joints = model.tree.order
    bodies = model.jnt_bodyid[joints]
    in_world = np.array([JOINTS[int(t)].in_world for t in model.tree.kind], bool)
    identity = ~model.link_first | in_world
    local = _local_poses(model, bodies, identity)
    parents = model.body_parentid[bodies]
    none = _identities(len(bodies), local.pos.dtype)
    above = jax.tree.map(lambda a, b: jnp.where(identity[:, None], b, take(a, parents)), body, none)
    return jax.vmap(Pose.__matmul__)(above, local)


def _merged_inertia(model: Model, body: Pose) -> Inertia:
    """Inertia of all bodies of each link, in the link frame about its origin."""
    on_link = np.nonzero(model.body_link >= 0)[0]
    principal = jax.vmap(Pose.__matmul__)(
        jax.tree.map(lambda a: take(a, on_link), body),
        Pose(
            quat=jax.vmap(quat_normalize)(take(model.body_iquat, on_link)),
            pos=take(model.body_ipos, on_link),
        ),
    )
    each = jax.vmap(Inertia.from_principal)(
        take(model.body_mass, on_link), principal, take(model.body_inertia, on_link)
    )
    return jax.tree.map(lambda a: sum_by(a, model.body_link[on_link], model.njnt), each)


def _identities(n: int, dtype) -> Pose:
    quat = jnp.asarray(np.array([1.0, 0.0, 0.0, 0.0]), dtype)
    return Pose(quat=jnp.broadcast_to(quat[None], (n, 4)), pos=jnp.zeros((n, 3), dtype))
