"""Links: the nodes of the tree over which the recursions run.

Each joint has one link. A body with three hinges is three links, of which the first two have no
mass. Bodies without joints belong to the link of the body to which they are fixed. All numbers are
computed from the model's leaves, so masses and poses can be changed, vmapped and differentiated.
"""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.dynamics.tree import outward
from jaxsim.joints import JOINTS
from jaxsim.model import Model
from jaxsim.spatial import Inertia, Pose, quat_normalize


@struct.dataclass
class Links:
    """Constant parameters of the links in tree order, and poses of the bodies on them.

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
    """Parameters of the links, computed from those of the bodies and joints."""
    body = _poses_on_carrier(model)
    joints = model.tree.order
    return Links(
        offset=_offsets(model, body),
        axis=jax.vmap(_normalized)(take(model.jnt_axis, joints)),
        anchor=take(model.jnt_pos, joints),
        inertia=_merged_inertia(model, body),
        body=body,
    )


def _normalized(axis: Float[Array, "3"]) -> Float[Array, "3"]:
    """The direction of an axis, so that its derivative is one of unit vectors."""
    return axis / norm_and_divisor(axis)[1]


def _poses_on_carrier(model: Model) -> Pose:
    """(nbody,) pose of each body on its carrier; the identity for carriers themselves."""
    forest = model.weld_tree
    is_carrier = forest.parent < 0
    local = _local_poses(model, forest.order, is_carrier)
    root = _identities(forest.nroot, local.pos.dtype)
    stacked, _ = outward(forest, lambda above, pose, _: (above @ pose, ()), root, local)
    return jax.tree.map(lambda a: take(a, forest.position), stacked)


def _local_poses(model: Model, bodies: np.ndarray, identity: np.ndarray) -> Pose:
    """Poses of bodies in their parents; the identity where the mask `identity` is true."""
    none = _identities(len(bodies), model.body_pos.dtype)
    quat = jax.vmap(quat_normalize)(take(model.body_quat, bodies))
    mask = identity[:, None]
    return Pose(
        quat=jnp.where(mask, none.quat, quat),
        pos=jnp.where(mask, none.pos, take(model.body_pos, bodies)),
    )


def _offsets(model: Model, body: Pose) -> Pose:
    """Pose of a body's first joint in the parent's link; the identity for further joints.

    It is the identity, too, for a joint whose pose is in the world (`Joint.in_world`).
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
