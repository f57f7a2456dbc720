"""How accurately the constraint problem of a model is solved."""

import functools

from jax import lax
from jaxtyping import Array, Float

from jaxsim.constraint.compaction import with_compacted_contacts
from jaxsim.constraint.operators import TreeOperator
from jaxsim.model import Model
from jaxsim.solver import Problem, Solution, solve

# The part of its gradient that a pass for rigid rows may leave, where linear solves are exact and
# where they are iterative, so that accuracy has a price.
_REDUCTION, _ROUGH_REDUCTION = 1e-4, 0.1
# The part of its first slope that a line search may leave, under laws other than MuJoCo's.
_LS_REDUCTION = 0.01


def minimiser(
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
        kinked=iterative and not soft and not for_passes,
        ls_reduction=0.0 if soft else _LS_REDUCTION,
    )

    def minimised(problem: Problem, guess: Float[Array, "nv"] | None) -> Solution:
        # `solve` has no derivatives, so its inputs need none.
        stopped = lax.stop_gradient((problem, operator))
        return with_compacted_contacts(functools.partial(minimise, x_start=guess), *stopped)

    return minimised
