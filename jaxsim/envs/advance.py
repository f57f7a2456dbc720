"""Several time steps with one action, and what is known at the end of them."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.engine.integrate import Step
from jaxsim.engine.step import whole_step
from jaxsim.model import Model, State


def advance(model: Model, state: State, ctrl: Float[Array, "nu"], steps: int) -> Step:
    """Take `steps` time steps with constant controls, as one loop.

    Args:
      model: the model.
      state: where to start.
      ctrl: controls.
      steps: how many; the size of the program does not depend on it.

    Returns:
      The last of the steps.
    """

    def body(found: Step, _):
        return whole_step(model, found.after, ctrl), None

    # What the loop starts from is overwritten by the first step.
    start = Step(state, state, jnp.zeros_like(state.qvel))
    return lax.scan(body, start, length=steps)[0]
