"""Free bodies that carry nothing: six equations of their own, gyroscopic forces included."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.forces.derivatives import Damping
from jaxsim.joints.types import FREE
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
    """Replace the accelerations of lone free bodies by `(M + h D + h dbias/dv)^-1 force`.

    Args:
      model: the model.
      kin: its kinematics.
      qvel: velocities.
      damping: D.
      force: right-hand side.
      qacc: accelerations to return for all other joints.
    """
    links = _candidates(model)
    if not len(links):
        return qacc
    h = model.opt.timestep
    joints = model.tree.order[links]
    dofs = model.jnt_dofadr[joints][:, None] + np.arange(6)
    extra = damping.dense
    extra = jnp.zeros((model.nv, model.nv), qvel.dtype) if extra is None else extra
    drag = damping.link_matrix
    drag = jnp.zeros((model.njnt, 6, 6), qvel.dtype) if drag is None else drag
    diagonal = dof_armature(model) + h * damping.diagonal

    def one(dof, axes, inertia, drag):
        bias = jax.jacfwd(lambda v: _bias(inertia, axes, v))(qvel[dof])
        matrix = axes @ (inertia.as_matrix() + h * drag) @ axes.T + jnp.diag(diagonal[dof])
        return jnp.linalg.solve(matrix + h * (bias + extra[dof][:, dof]), force[dof])

    axes = take(kin.cdof, (model.tree.dof_start[links][:, None] + np.arange(6)).reshape(-1))
    inertia = jax.tree.map(lambda a: take(a, links), kin.inertia)
    solved = jax.vmap(one)(jnp.asarray(dofs), axes.reshape(-1, 6, 6), inertia, take(drag, links))
    bodies = model.jnt_bodyid[joints]
    # Bodies may carry others that are welded to them; MuJoCo tells by the mass.
    lone = take(model.body_subtreemass, bodies) == take(model.body_mass, bodies)
    return qacc.at[dofs].set(jnp.where(lone[:, None], solved, qacc[dofs]))


def _bias(inertia: Inertia, axes, qvel) -> Float[Array, "6"]:
    """Velocity-dependent forces; the first three axes, translations, do not turn."""
    twist = qvel @ axes
    rate = cross_motion(twist, qvel[3:] @ axes[3:])
    return axes @ (inertia.apply(rate) + cross_force(twist, inertia.apply(twist)))


def _candidates(model: Model) -> np.ndarray:
    """Links of free joints that no other joint hangs on; static."""
    tree = model.tree
    is_parent = np.zeros(len(tree), bool)
    is_parent[tree.parent[tree.parent >= 0]] = True
    return np.nonzero((tree.kind == FREE) & ~is_parent)[0]
