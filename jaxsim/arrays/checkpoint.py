"""Checkpointing for simulations: reverse mode that stores states and recomputes the rest."""

from collections.abc import Callable

import jax

# `checkpoint_name` of the constraint solver's solution; checkpoint policies refer to it.
SOLUTION = "jaxsim_solution"

_KEEP = jax.checkpoint_policies.save_only_these_names(SOLUTION)


def checkpoint(f: Callable) -> Callable:
    """Return `f` so that reverse mode stores only its arguments and the solver's accelerations.

    This is `jax.checkpoint` with a policy for simulations. The backward pass evaluates `f` again,
    but it does not repeat the constraint solve: the derivative of the solve needs only its solution
    (see `jaxsim.solver.implicit`). Use it for one step of a loop that is differentiated:

        step = jaxsim.checkpoint(lambda state, ctrl: jaxsim.step(model, state, ctrl))
        state, _ = lax.scan(lambda state, ctrl: (step(state, ctrl), None), state, ctrls)

    `jaxsim.rollout` does this by itself.

    Args:
      f: a function of pytrees, such as `jaxsim.step` or the step of an environment.

    Returns:
      A function with the same values and derivatives.
    """
    return jax.checkpoint(f, policy=_KEEP)
