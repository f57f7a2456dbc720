"""Lone free bodies, whose solves are in their own axes.

The inertia of a rod about its axis is less than its others by the square of its slenderness. In
oblique axes every entry of an inertia, and of the stiffness of contacts, has the size of the
largest, and what rounding takes of it may be more than the smallest. So may the part of a fast spin
about the axis that rounding turns into the other directions. In the axes of the body each entry and
each component has its own size.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.joints.free import FREE
from jaxsim.model import Model
from jaxsim.model.facts import fact
from jaxsim.spatial import Inertia, quat_to_matrix


@fact()
def free_links(model: Model) -> np.ndarray:
    """Links with a free joint and without child links, in tree order."""
    tree = model.tree
    free = tree.kind == FREE.number
    free[tree.parent[tree.parent >= 0]] = False
    return np.nonzero(free)[0]


def free_dofs(model: Model) -> np.ndarray:
    """(n, 6) degrees of freedom of the links of `free_links`, in MuJoCo's order."""
    return model.jnt_dofadr[model.tree.order[free_links(model)]][:, None] + np.arange(6)


def own_axes(model: Model, kin: Kinematics) -> Float[Array, "njnt 3 3"] | None:
    """Columns are the axes in which each link is solved; None if all are the world's.

    They are those of the body for a lone free body, the world's for other links.
    """
    links = free_links(model)
    if not len(links):
        return None
    axes = jax.vmap(quat_to_matrix)(take(kin.link_pose.quat, links))
    world = jnp.broadcast_to(jnp.eye(3, dtype=axes.dtype)[None], (model.njnt, 3, 3))
    return replace_rows(world, links, axes)


def own_inertia(model: Model, kin: Kinematics) -> Inertia:
    """Inertias of the links in the axes of `own_axes`, about the trees' reference points."""
    links = free_links(model)
    local = jax.tree.map(lambda x: take(x, links), kin.link_inertia)
    return jax.tree.map(lambda x, y: replace_rows(x, links, y), kin.inertia, local)


def own_motion_axes(
    model: Model, kin: Kinematics, axes: Float[Array, "njnt 3 3"]
) -> Float[Array, "nv 6"]:
    """Motion axes in the axes of `own_axes`, tree order.

    Those of a free joint are translations along the world's axes and rotations about its own.
    """
    links = free_links(model)

    def free(R):
        turns = jnp.eye(3, 6, dtype=R.dtype)
        return jnp.concatenate([jnp.concatenate([jnp.zeros_like(R), R], axis=1), turns])

    dofs = (model.tree.dof_start[links][:, None] + np.arange(6)).ravel()
    return replace_rows(kin.cdof, dofs, jax.vmap(free)(take(axes, links)).reshape(-1, 6))


def in_axes(twists: Float[Array, "*n 6"], axes: Float[Array, "3 3"]) -> Float[Array, "*n 6"]:
    """Twists or wrenches, angular first, in axes that are the columns of a matrix."""
    return jnp.concatenate([twists[..., :3] @ axes, twists[..., 3:] @ axes], axis=-1)


def replace_rows(x: Array, rows: np.ndarray, values: Array) -> Array:
    """`x` with the rows of these indices replaced."""
    source = np.arange(len(x))
    source[rows] = len(x) + np.arange(len(rows))
    return take(jnp.concatenate([x, values]), source)
