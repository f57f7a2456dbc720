"""Accelerations with implicit damping."""

import jax
from jaxtyping import Array, Float

from jaxsim.batching.matrices import solve
from jaxsim.dynamics.aba import solve_articulated
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia
from jaxsim.engine.instant import Instant
from jaxsim.forces.derivatives import Damping, damping_matrix
from jaxsim.model import Model


def solve_damped(
    model: Model, now: Instant, damping: Damping, force: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """`(M + h D)^-1 force`, in O(n) unless M or D has a dense part; D is made symmetric."""
    h, kin = model.opt.timestep, now.motion.kin
    if damping.link_matrix is not None:
        mean = (damping.link_matrix + damping.link_matrix.mT) / 2
        damping = damping.replace(link_matrix=mean)
    if damping.dense is not None or has_tendon_inertia(model):
        matrix = composite_mass_matrix(model, kin) + h * damping_matrix(model, kin, damping)
        return solve(matrix, force)
    links = jax.vmap(lambda inertia: inertia.as_matrix())(kin.inertia)
    if damping.link_matrix is not None:
        links = links + h * damping.link_matrix
    diagonal = dof_armature(model) + h * damping.diagonal
    return solve_articulated(model, kin.cdof, links, diagonal, force)
