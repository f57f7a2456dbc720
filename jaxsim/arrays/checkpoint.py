"""Reverse mode whose memory grows with the states, not with what a step computes."""

from collections.abc import Callable

import jax

# The name of minimisers, for policies of `jax.checkpoint` that say what to keep.
SOLUTION = "jaxsim_solution"

_KEEP = jax.checkpoint_policies.save_only_these_names(SOLUTION)


def checkpoint(f: Callable) -> Callable:
    """The same function, of which reverse mode remembers the arguments and the accelerations.

    `jax.checkpoint` with the right policy for simulations: the backward pass repeats `f` to get
    what it needs, except for the constraint solver, whose derivative takes the acceleration only
    (see `jaxsim.solver.implicit`). For one step of a loop that is differentiated:

        step = jaxsim.checkpoint(lambda state, ctrl: jaxsim.step(model, state, ctrl))
        state, _ = lax.scan(lambda state, ctrl: (step(state, ctrl), None), state, ctrls)

    `jaxsim.rollout` does this by itself.

    Args:
      f: a function of pytrees, such as `jaxsim.step` or the step of an environment.
    """
    return jax.checkpoint(f, policy=_KEEP)
