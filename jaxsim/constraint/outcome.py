"""`Constrained`: what a constraint solve found, in MuJoCo's order."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.collision import Contact
from jaxsim.constraint.block import Block
from jaxsim.constraint.contact import contact_forces
from jaxsim.constraint.operators import TreeOperator
from jaxsim.dynamics.motion import Motion
from jaxsim.model.dof_order import from_compound_order
from jaxsim.solver import LinearStatus, SolverStatus
from jaxsim.solver.operator import Lifted, Rows


@struct.dataclass
class Constrained:
    """Acceleration and constraint forces, in MuJoCo's order.

    Attributes:
      qacc: acceleration.
      qfrc_constraint: generalised force of all constraints.
      contact: the contacts.
      contact_force: (force, torque) of each contact in its frame.
      blocks: the rows: equalities, dry friction, limits and contacts.
      forces: forces of the rows of each block.
      status: status of the solver.
      displacement: what impacts within a time step add to its path; None if the law has none.
    """

    qacc: Float[Array, "nv"]
    qfrc_constraint: Float[Array, "nv"]
    contact: Contact
    contact_force: Float[Array, "nc 6"]
    blocks: tuple[Block, ...]
    forces: tuple[Array, ...]
    status: SolverStatus
    displacement: Float[Array, "nv"] | None = None


def outcome(
    motion: Motion,
    contact: Contact,
    blocks: list[Block],
    operator: TreeOperator,
    y: Lifted,
    forces: Rows,
    status: SolverStatus,
) -> Constrained:
    """The result in MuJoCo's order, from a lifted acceleration and the forces of the rows."""
    model, x = motion.model, operator.vector(y)
    return Constrained(
        qacc=from_compound_order(model, x),
        qfrc_constraint=from_compound_order(model, operator.pull(forces)),
        contact=contact,
        contact_force=contact_forces(contact, blocks, forces),
        blocks=tuple(blocks),
        forces=forces,
        status=status,
    )


def with_nan_unless(finite: Bool[Array, ""], found: Constrained) -> Constrained:
    """The result, with NaN as acceleration and force unless `finite`.

    The solver itself rejects steps that are not finite and returns its last point. Derivatives are
    those of `found`.
    """
    nothing = jnp.where(finite, 0, jnp.nan).astype(found.qacc.dtype)
    return found.replace(qacc=found.qacc + nothing, qfrc_constraint=found.qfrc_constraint + nothing)


def unconstrained_status(cost: Float[Array, ""]) -> SolverStatus:
    """That of an acceleration that needed no solve."""
    zero = jnp.zeros_like(cost)
    return SolverStatus(
        iterations=jnp.zeros((), jnp.int32),
        residual=zero,
        improvement=zero,
        cost=cost,
        finite=jnp.isfinite(cost),
        converged=jnp.ones((), bool),
        linear=LinearStatus(),
    )
