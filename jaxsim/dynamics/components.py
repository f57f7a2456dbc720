"""The components of twists that can be nonzero in a model.

Twists are in world axes about a fixed point. In a planar mechanism, where all hinges have the same
axis, most of the six components are always zero. Articulated solves leave these out: a planar link
then has a 3x3 inertia, a slider a 1x1 inertia.

Values and derivatives stay exact: components are left out only if the axes of the joints are
numbers while a program is traced, not arguments that may be mapped or differentiated.
"""

import functools

import jax
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.joints import JOINTS
from jaxsim.model import Model
from jaxsim.model.facts import fact
from jaxsim.model.structure import Structure
from jaxsim.spatial import Inertia

Components = tuple[int, ...]

ALL: Components = tuple(range(6))


@struct.dataclass
class RestrictedInertia:
    """An inertia for twists with c components.

    Attributes:
      matrix: rows and columns of the spatial inertia for these components.
    """

    matrix: Float[Array, "c c"]

    def apply(self, V: Float[Array, "c"]) -> Float[Array, "c"]:
        """Momentum `G V`."""
        return self.matrix @ V

    def as_matrix(self) -> Float[Array, "c c"]:
        """The matrix."""
        return self.matrix


@fact("jnt_axis", "body_quat", unknown=ALL)
def motion_components(model: Model, axes: np.ndarray, quats: np.ndarray) -> Components:
    """Components of twists, angular first, that can be nonzero for some motion of some link.

    All six if the axes of the joints are traced.
    """
    structure = model.structure
    joints = [JOINTS[int(t)] for t in structure.jnt_type]
    turns = np.array([joint.turns_about_axis for joint in joints], bool)
    slides = np.array([joint.slides_along_axis for joint in joints], bool)
    on_mocap = structure.body_mocapid[structure.body_rootid[structure.jnt_bodyid]] >= 0
    if structure.njnt == 0 or not (turns | slides).all() or on_mocap.any():
        return ALL
    directions = _world_axes(structure, axes, quats)
    angular, along = (np.abs(directions[some]).max(0, initial=0) > 0 for some in (turns, slides))
    if angular.sum() > 1:
        return ALL
    # A rotation moves points only in the plane across its axis.
    linear = along | ~angular if angular.any() else along
    return tuple(np.nonzero(np.concatenate([angular, linear]))[0].tolist())


def restrict(components: Components, twists: Float[Array, "*n 6"]) -> Float[Array, "*n c"]:
    """Select components of twists or wrenches."""
    if components == ALL:
        return twists
    one = functools.partial(take, index=np.array(components))
    for _ in twists.shape[:-1]:
        one = jax.vmap(one)
    return one(twists)


def restrict_matrix(components: Components, matrix: Float[Array, "6 6"]) -> Float[Array, "c c"]:
    """Select the rows and columns of a 6x6 matrix for these components."""
    return restrict(components, take(matrix, np.array(components)))


def restrict_inertia(components: Components, inertia: Inertia) -> Inertia | RestrictedInertia:
    """The inertia for twists with these components."""
    if components == ALL:
        return inertia
    return RestrictedInertia(restrict_matrix(components, inertia.as_matrix()))


def _world_axes(structure: Structure, axes: np.ndarray, quats: np.ndarray) -> np.ndarray:
    """(njnt, 3) axes of all joints in world axes, at zero displacement of all joints.

    If all hinges are parallel in this configuration, they are parallel in every configuration.
    """
    turned = np.array(quats, float)
    for body in range(1, structure.nbody):
        mujoco.mju_mulQuat(turned[body], turned[structure.body_parentid[body]], turned[body].copy())
    world = np.array(axes, float)
    for joint, body in enumerate(structure.jnt_bodyid):
        mujoco.mju_rotVecQuat(world[joint], world[joint].copy(), turned[body])
    return world
