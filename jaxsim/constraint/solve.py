"""The constrained acceleration: assembly of all rows and solution of the convex problem."""

import functools
from collections.abc import Sequence

import jax.numpy as jnp
import mujoco
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.arrays import tuning
from jaxsim.collision import Contact
from jaxsim.constraint.backward import check_backward, softened, with_derivative_of
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.compaction import with_compacted_contacts
from jaxsim.constraint.contact import contact_blocks, contact_forces
from jaxsim.constraint.entry import entry_acceleration
from jaxsim.constraint.equality import equality_blocks
from jaxsim.constraint.friction import friction_blocks
from jaxsim.constraint.impact import at_targets, correction, impact, impact_displacement
from jaxsim.constraint.laws import ON_VELOCITIES, RIGID, Blur, check_law
from jaxsim.constraint.limit import limit_blocks
from jaxsim.constraint.noslip import PASSES, without_slip
from jaxsim.constraint.operators import TreeOperator, make_operator
from jaxsim.constraint.row_inertia import with_inverse_mass
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia
from jaxsim.forces.damper import damps_dofs, dof_damping_slope
from jaxsim.model import Model, ModelError
from jaxsim.model.dof_order import from_compound_order, to_compound_order
from jaxsim.solver import LinearStatus, Problem, Solution, SolverStatus, attach_lifted, solve
from jaxsim.solver.operator import Lifted, Rows
from jaxsim.solver.passes import (
    attach_rigid,
    first_shifts,
    rigid_tolerance,
    softness,
    solve_rigid,
)

_CONSTRAINT_OFF = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_CONTACT_OFF = mujoco.mjtDisableBit.mjDSBL_CONTACT
_EULERDAMP = mujoco.mjtDisableBit.mjDSBL_EULERDAMP
_WARMSTART_OFF = mujoco.mjtDisableBit.mjDSBL_WARMSTART

# The part of its gradient that a pass for rigid rows may leave, where linear solves are exact and
# where they are iterative, so that accuracy has a price.
_REDUCTION, _ROUGH_REDUCTION = 1e-4, 0.1
# The part of its first slope that a line search may leave, under laws other than MuJoCo's.
_LS_REDUCTION = 0.01

# Parts of a solution whose derivatives `Model.backward` changes.
_RESULTS = ("qacc", "qfrc_constraint", "contact_force", "forces")


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


def constraint_blocks(motion: Motion, contact: Contact, blur: Blur | None = None) -> list[Block]:
    """All constraint rows, in MuJoCo's order; those of contacts may be blurred."""
    if motion.model.opt.disabled(_CONSTRAINT_OFF) or motion.model.nv == 0:
        return []
    motion = with_inverse_mass(motion)
    blocks = [*equality_blocks(motion), *friction_blocks(motion), *limit_blocks(motion)]
    if not motion.model.opt.disabled(_CONTACT_OFF):
        blocks += contact_blocks(motion, contact, blur)
    return blocks


def constrained_acceleration(
    motion: Motion,
    contact: Contact,
    qfrc_smooth: Float[Array, "nv"],
    qacc_warmstart: Float[Array, "nv"],
    others: Sequence[Block] = (),
) -> Constrained:
    """Minimise `1/2 |a - qacc_smooth|_M^2 + s(J a - aref)`, where `M qacc_smooth = qfrc_smooth`.

    The derivative is that of the exact minimum, see `jaxsim.solver.implicit`, or of the minimum
    with softer contacts, see `Model.backward`. If an input or the result of the solve is not
    finite, the acceleration is NaN.

    Args:
      motion: position and velocity.
      contact: the contacts there.
      qfrc_smooth: all generalised forces except those of constraints, minus the bias.
      qacc_warmstart: initial guess of the acceleration; if the model disables warm starts, the
        guess is `qacc_smooth`.
      others: rows that are not the model's own.
    """
    model = motion.model
    check_law(model)
    check_backward(model)
    found = _solved(motion, contact, qfrc_smooth, qacc_warmstart, others)
    if not model.backward.smooths:
        return found
    soft = _solved(motion, softened(contact, model.backward), qfrc_smooth, found.qacc, others)
    results = lambda found: {name: getattr(found, name) for name in _RESULTS}  # noqa: E731
    return found.replace(**with_derivative_of(results(found), results(soft)))


def _solved(
    motion: Motion,
    contact: Contact,
    qfrc_smooth: Float[Array, "nv"],
    qacc_warmstart: Float[Array, "nv"],
    others: Sequence[Block],
) -> Constrained:
    """The constrained acceleration, with its own derivative."""
    model = motion.model
    blocks = [*others, *constraint_blocks(motion, contact)]
    operator = make_operator(model, motion.kin, blocks, choose_strategy(model, blocks))
    operator = _with_damping(motion, operator)
    problem = Problem(tuple(block.kind for block in blocks))
    force = to_compound_order(model, qfrc_smooth)
    if not blocks:
        y = operator.unconstrained(force)
        status = _unconstrained_status(-0.5 * force @ operator.vector(y))
        return _outcome(motion, contact, blocks, operator, y, (), status)
    warm = not model.opt.disabled(_WARMSTART_OFF)
    guess = to_compound_order(model, qacc_warmstart) if warm else None
    if any(block.rigid or block.approach is not None for block in blocks):
        found = _rigid(motion, contact, blocks, operator, force, guess)
        return _with_nan_unless(found.status.finite, found)
    found = _minimiser(model, operator, force)(problem, guess)
    y = attach_lifted(found.x, problem, operator, force)
    forces, status = problem.forces(operator.rows(y)), found.status
    if model.opt.noslip_iterations:
        minimiser = functools.partial(_minimiser, model, operator, for_passes=True)
        y, forces, found = without_slip(blocks, operator, force, y, minimiser)
        status = found.status_after(status)
    found = _outcome(motion, contact, blocks, operator, y, forces, status)
    return _with_nan_unless(found.status.finite, found)


def with_entry_times(motion: Motion, found: Constrained, qfrc_smooth: Float[Array, "nv"]):
    """The same, with the derivative of the times at which rows began to act in the last step.

    It is for time steps: `qacc` is the mean of the acceleration during the step, not that at its
    beginning. See `jaxsim.constraint.entry`.

    Args:
      motion: position and velocity.
      found: the solution there.
      qfrc_smooth: as for `constrained_acceleration`.
    """
    model, blocks = motion.model, list(found.blocks)
    entries = [block.entry for block in blocks]
    if all(entry is None for entry in entries):
        return found
    operator = make_operator(model, motion.kin, blocks, choose_strategy(model, blocks))
    minimiser = _minimiser(model, operator, to_compound_order(model, qfrc_smooth))
    x = to_compound_order(model, found.qacc)
    change = entry_acceleration(
        model.opt.timestep,
        entries,
        [block.kind for block in blocks],
        found.forces,
        operator,
        x,
        lambda problem: minimiser(problem, x).x,
    )
    y = operator.lift(change)
    force = -operator.residual(y, tuple(jnp.zeros_like(rows) for rows in operator.rows(y)))
    return found.replace(
        qacc=found.qacc + from_compound_order(model, change),
        qfrc_constraint=found.qfrc_constraint + from_compound_order(model, force),
    )


def _rigid(
    motion: Motion, contact: Contact, blocks: list[Block], operator: TreeOperator, force, guess
) -> Constrained:
    """The solution with rigid rows; impacts of contacts are those without contact forces."""
    model, h = motion.model, motion.model.opt.timestep
    free = operator.unconstrained(force)
    impacts = []
    for i, (block, acceleration) in enumerate(zip(blocks, operator.rows(free), strict=True)):
        if (approach := block.approach) is not None:
            found = impact(h, approach, acceleration[:, 0])
            blocks[i] = block.replace(kind=at_targets(h, block.kind, approach, found))
            impacts.append((i, approach, found))
    problem = Problem(tuple(b.kind for b in blocks))
    rigid = tuple(i for i, b in enumerate(blocks) if b.rigid or b.approach is not None)
    found = solve_rigid(
        problem,
        operator,
        rigid,
        _minimiser(model, operator, force, for_passes=True),
        operator.vector(free) if guess is None else guess,
        first_shifts(problem, rigid),
        passes=PASSES,
        tolerance=rigid_tolerance(force.dtype),
    )
    y, forces = attach_rigid(found, problem, operator, force, rigid)
    outcome = _outcome(motion, contact, blocks, operator, y, forces, found.whole_status())
    held = [
        (i, block.violation, softness(force.dtype) / block.kind.D)
        for i, block in enumerate(blocks)
        if block.type is RowType.HOLD and block.violation is not None
    ]
    if not impacts and not held:
        return outcome
    moved = impact_displacement(h, impacts, forces, operator)
    moved = moved + correction(impacts, held, problem.blocks, forces, operator)
    return outcome.replace(displacement=from_compound_order(model, moved))


def _with_damping(motion: Motion, operator: TreeOperator) -> TreeOperator:
    """With `M + h D` for M, D the damping of the joints, where contacts ask for velocities.

    It is what the velocity after the step is made with, see `engine/integrators/euler.py`.
    """
    model = motion.model
    explicit = model.opt.disabled(_EULERDAMP) or damps_dofs(model) is False
    if model.contact not in ON_VELOCITIES or explicit:
        return operator
    damping = model.opt.timestep * dof_damping_slope(model, motion.qvel)
    return operator.replace(armature=operator.armature + to_compound_order(model, damping))


def _minimiser(
    model: Model,
    operator: TreeOperator,
    force: Float[Array, "nv"],
    for_passes: bool = False,
):
    """A function from a problem and an initial guess (or None) to its `Solution`.

    Each pass begins where the last has ended. It need not be more accurate than the next one will
    be, and the last ones have to be as accurate as rounding allows.
    """
    soft, iterative = model.contact == "mujoco", operator.strategy == "iterative"
    reduction = _ROUGH_REDUCTION if iterative else _REDUCTION
    minimise = functools.partial(
        solve,
        force=force,
        iterations=model.opt.iterations,
        ls_iterations=model.opt.ls_iterations,
        tolerance=0.0 if for_passes else model.opt.tolerance,
        ls_tolerance=model.opt.ls_tolerance,
        scale=1 / (model.stat.meaninertia * max(1, model.nv)),
        compare=not for_passes,
        reduction=reduction if for_passes else 0.0,
        inexact=iterative and not soft,
        ls_reduction=0.0 if soft else _LS_REDUCTION,
    )

    def minimised(problem: Problem, guess: Float[Array, "nv"] | None) -> Solution:
        # `solve` has no derivatives, so its inputs need none.
        stopped = lax.stop_gradient((problem, operator))
        return with_compacted_contacts(functools.partial(minimise, x_start=guess), *stopped)

    return minimised


def constrained_at(
    motion: Motion,
    contact: Contact,
    qacc: Float[Array, "nv"],
    blur: Blur | None = None,
) -> Constrained:
    """The constraint forces for a known acceleration, which need no solve.

    Args:
      motion: position and velocity.
      contact: the contacts there.
      qacc: acceleration.
      blur: how much the law of contact is smoothed; None for the law itself.
    """
    if motion.model.contact in RIGID:
        raise ModelError(
            f"contact={motion.model.contact!r} has no forces that are a function of the "
            "acceleration; load the model with another contact law for its inverse dynamics"
        )
    blocks = constraint_blocks(motion, contact, blur)
    operator = make_operator(motion.model, motion.kin, blocks, "articulated")
    y = operator.lift(to_compound_order(motion.model, qacc))
    forces = Problem(tuple(block.kind for block in blocks)).forces(operator.rows(y))
    status = _unconstrained_status(jnp.zeros((), qacc.dtype))
    return _outcome(motion, contact, blocks, operator, y, forces, status)


def _outcome(
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


def _with_nan_unless(finite: Bool[Array, ""], found: Constrained) -> Constrained:
    """The result, with NaN as acceleration and force unless `finite`.

    The solver itself rejects steps that are not finite and returns its last point. Derivatives are
    those of `found`.
    """
    nothing = jnp.where(finite, 0, jnp.nan).astype(found.qacc.dtype)
    return found.replace(qacc=found.qacc + nothing, qfrc_constraint=found.qfrc_constraint + nothing)


def choose_strategy(model: Model, blocks: list[Block]) -> str:
    """The strategy of the Newton step: `Model.hessian`, or for "auto" one that fits the rows.

    "auto" is articulated if neither rows nor armature of tendons couple two moving links, else
    dense for few degrees of freedom and iterative for many.

    Raises:
      ModelError: `Model.hessian` is "articulated", but something couples moving links.
    """
    coupled = [f"{block.type.value} rows" for block in blocks if block.jacobian.coupled]
    coupled += ["tendons with armature"] if has_tendon_inertia(model) else []
    if model.hessian == "articulated" and coupled:
        raise ModelError(
            f"{coupled[0]} couple degrees of freedom beyond the tree, which "
            "hessian='articulated' cannot solve; load the model with 'auto', 'dense' or 'iterative'"
        )
    if model.hessian != "auto":
        return model.hessian
    if not coupled:
        return "articulated"
    return "dense" if model.nv <= tuning.DENSE_DOFS else "iterative"


def _unconstrained_status(cost: Float[Array, ""]) -> SolverStatus:
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
