"""The acceleration with rigid rows: targets from impacts, passes, displacement."""

from jaxsim.collision import Contact
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.minimiser import minimiser
from jaxsim.constraint.operators import TreeOperator
from jaxsim.constraint.outcome import Constrained, outcome
from jaxsim.constraint.rigid.displacement import displacement
from jaxsim.constraint.rigid.impact import at_targets, impact
from jaxsim.constraint.rigid.noslip import PASSES
from jaxsim.dynamics.motion import Motion
from jaxsim.model.dof_order import from_compound_order
from jaxsim.solver import Problem
from jaxsim.solver.passes import (
    attach_rigid,
    first_shifts,
    rigid_tolerance,
    softness,
    solve_rigid,
)


def rigid_solution(
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
        minimiser(model, operator, force, for_passes=True),
        operator.vector(free) if guess is None else guess,
        first_shifts(problem, rigid),
        passes=PASSES,
        tolerance=rigid_tolerance(force.dtype),
    )
    y, forces = attach_rigid(found, problem, operator, force, rigid)
    result = outcome(motion, contact, blocks, operator, y, forces, found.whole_status())
    held = [
        (i, block.violation, softness(force.dtype) / block.kind.D)
        for i, block in enumerate(blocks)
        if block.type is RowType.HOLD and block.violation is not None
    ]
    if not impacts and not held:
        return result
    moved = displacement(h, impacts, held, problem.blocks, forces, operator)
    return result.replace(displacement=from_compound_order(model, moved))
