"""The constrained acceleration: assembly of all rows and solution of the convex problem."""

import functools
from collections.abc import Sequence

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays import tuning
from jaxsim.collision import Contact
from jaxsim.constraint.backward import check_backward, softened, with_derivative_of
from jaxsim.constraint.block import Block
from jaxsim.constraint.contact import contact_blocks
from jaxsim.constraint.entry import entry_acceleration
from jaxsim.constraint.equality import equality_blocks
from jaxsim.constraint.friction import friction_blocks
from jaxsim.constraint.laws import ON_VELOCITIES, RIGID, Blur, check_law
from jaxsim.constraint.limit import limit_blocks
from jaxsim.constraint.minimiser import minimiser
from jaxsim.constraint.operators import TreeOperator, make_operator
from jaxsim.constraint.outcome import (
    Constrained,
    outcome,
    unconstrained_status,
    with_nan_unless,
)
from jaxsim.constraint.rigid.noslip import without_slip
from jaxsim.constraint.rigid.solution import rigid_solution
from jaxsim.constraint.row_inertia import with_inverse_mass
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia
from jaxsim.forces.damper import damps_dofs, dof_damping_slope
from jaxsim.model import Model, ModelError
from jaxsim.model.dof_order import from_compound_order, to_compound_order
from jaxsim.solver import Problem, attach_lifted

_CONSTRAINT_OFF = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_CONTACT_OFF = mujoco.mjtDisableBit.mjDSBL_CONTACT
_EULERDAMP = mujoco.mjtDisableBit.mjDSBL_EULERDAMP
_WARMSTART_OFF = mujoco.mjtDisableBit.mjDSBL_WARMSTART

# Parts of a solution whose derivatives `Model.backward` changes.
_RESULTS = ("qacc", "qfrc_constraint", "contact_force", "forces")


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
        status = unconstrained_status(-0.5 * force @ operator.vector(y))
        return outcome(motion, contact, blocks, operator, y, (), status)
    warm = not model.opt.disabled(_WARMSTART_OFF)
    guess = to_compound_order(model, qacc_warmstart) if warm else None
    if any(block.rigid or block.approach is not None for block in blocks):
        found = rigid_solution(motion, contact, blocks, operator, force, guess)
        return with_nan_unless(found.status.finite, found)
    found = minimiser(model, operator, force)(problem, guess)
    y = attach_lifted(found.x, problem, operator, force)
    forces, status = problem.forces(operator.rows(y)), found.status
    if model.opt.noslip_iterations:
        minimise = functools.partial(minimiser, model, operator, for_passes=True)
        y, forces, found = without_slip(blocks, operator, force, y, minimise)
        status = found.status_after(status)
    found = outcome(motion, contact, blocks, operator, y, forces, status)
    return with_nan_unless(found.status.finite, found)


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
    minimise = minimiser(model, operator, to_compound_order(model, qfrc_smooth))
    x = to_compound_order(model, found.qacc)
    change = entry_acceleration(
        model.opt.timestep,
        entries,
        [block.kind for block in blocks],
        found.forces,
        operator,
        x,
        lambda problem: minimise(problem, x).x,
    )
    y = operator.lift(change)
    force = -operator.residual(y, tuple(jnp.zeros_like(rows) for rows in operator.rows(y)))
    return found.replace(
        qacc=found.qacc + from_compound_order(model, change),
        qfrc_constraint=found.qfrc_constraint + from_compound_order(model, force),
    )


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
    status = unconstrained_status(jnp.zeros((), qacc.dtype))
    return outcome(motion, contact, blocks, operator, y, forces, status)


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
