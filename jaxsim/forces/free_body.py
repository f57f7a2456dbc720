"""Implicit acceleration of single free bodies, with the derivative of gyroscopic forces.

As in MuJoCo's integrator `implicitfast`, which ignores that derivative for all other joints.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.batching.matrices import solve
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia, tendon_inertia
from jaxsim.forces.derivatives import Damping
from jaxsim.joints import JOINTS, Joint
from jaxsim.model import Model
from jaxsim.spatial import Inertia, cross_force, cross_motion


def solve_free_bodies(
    model: Model,
    kin: Kinematics,
    qvel: Float[Array, "nv"],
    damping: Damping,
    force: Float[Array, "nv"],
    qacc: Float[Array, "nv"],
) -> Float[Array, "nv"]:
    """Replace the accelerations of single free bodies by `(M + h D + h dbias/dv)^-1 force`.

    Args:
      model: the model.
      kin: its kinematics.
      qvel: velocities.
      damping: D.
      force: right-hand side, generalised forces.
      qacc: accelerations of all joints.

    Returns:
      Accelerations, those of all other joints unchanged.
    """
    for lone, dofs, matrix in _systems(model, kin, qvel, damping):
        qacc = _replaced(qacc, lone, dofs, jax.vmap(solve)(matrix, force[dofs]))
    return qacc


def multiply_free_bodies(
    model: Model,
    kin: Kinematics,
    qvel: Float[Array, "nv"],
    damping: Damping,
    qacc: Float[Array, "nv"],
    force: Float[Array, "nv"],
) -> Float[Array, "nv"]:
    """Replace the forces on single free bodies by `(M + h D + h dbias/dv) qacc`.

    The inverse of `solve_free_bodies`, with the same arguments.
    """
    for lone, dofs, matrix in _systems(model, kin, qvel, damping):
        force = _replaced(force, lone, dofs, jax.vmap(jnp.matmul)(matrix, qacc[dofs]))
    return force


def _replaced(x, lone, dofs, value) -> Float[Array, "nv"]:
    return x.at[dofs].set(jnp.where(lone[:, None], value, x[dofs]))


def _systems(model: Model, kin: Kinematics, qvel, damping: Damping) -> Iterator[tuple]:
    """For each type of joint, which bodies are alone, their degrees of freedom and matrices."""
    links = _candidates(model)
    for kind in np.unique(model.tree.kind[links]):
        some = links[model.tree.kind[links] == kind]
        joints = model.tree.order[some]
        bodies, dofs = model.jnt_bodyid[joints], _dofs(JOINTS[int(kind)], model.jnt_dofadr[joints])
        # A body that carries others is left out; as in MuJoCo, these are found by their mass.
        lone = take(model.body_subtreemass, bodies) == take(model.body_mass, bodies)
        yield lone, dofs, _matrices(model, kin, JOINTS[int(kind)], some, qvel, damping)


def _matrices(model: Model, kin: Kinematics, joint: Joint, links: np.ndarray, qvel, damping):
    """(n, joint.nv, joint.nv) `M + h D + h dbias/dv` of n links with the same type of joint."""
    h = model.opt.timestep
    dofs = _dofs(joint, model.jnt_dofadr[model.tree.order[links]])
    extra = damping.dense
    extra = jnp.zeros((model.nv, model.nv), qvel.dtype) if extra is None else h * extra
    if has_tendon_inertia(model):
        extra = extra + tendon_inertia(model, kin)
    drag = damping.link_matrix
    drag = jnp.zeros((model.njnt, 6, 6), qvel.dtype) if drag is None else drag
    diagonal = dof_armature(model) + h * damping.diagonal

    def one(dof, axes, inertia, drag):
        bias = jax.jacfwd(lambda v: _bias(joint, inertia, axes, v))(qvel[dof])
        matrix = axes @ (inertia.as_matrix() + h * drag) @ axes.T + jnp.diag(diagonal[dof])
        return matrix + h * bias + extra[dof][:, dof]

    axes = take(kin.cdof, _dofs(joint, model.tree.dof_start[links]).ravel())
    inertia = jax.tree.map(lambda a: take(a, links), kin.inertia)
    return jax.vmap(one)(
        jnp.asarray(dofs), axes.reshape(-1, joint.nv, 6), inertia, take(drag, links)
    )


def _bias(joint: Joint, inertia: Inertia, axes, qvel) -> Float[Array, "nv"]:
    """Velocity-dependent forces of one body; axes that turn with it have the rate `v x axis`."""
    (turns,) = np.nonzero(np.array(joint.turns))
    twist = qvel @ axes
    rate = cross_motion(twist, take(qvel, turns) @ take(axes, turns))
    return axes @ (inertia.apply(rate) + cross_force(twist, inertia.apply(twist)))


def _dofs(joint: Joint, start: np.ndarray) -> np.ndarray:
    """(n, joint.nv) degrees of freedom of joints, from the first one of each."""
    return start[:, None] + np.arange(joint.nv)


def _candidates(model: Model) -> np.ndarray:
    """Links with a free joint and without child links; static."""
    tree = model.tree
    in_world = np.array([JOINTS[int(kind)].in_world for kind in tree.kind], bool)
    in_world[tree.parent[tree.parent >= 0]] = False
    return np.nonzero(in_world)[0]
