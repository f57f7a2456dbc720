"""Several time steps with one action."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.engine.integrators import Step
from jaxsim.engine.status import Status
from jaxsim.engine.stepping import whole_step
from jaxsim.model import Model, State


def advance(model: Model, state: State, ctrl: Float[Array, "nu"], steps: int) -> Step:
    """Take `steps` time steps with constant controls, as one loop.

    Args:
      model: the model.
      state: initial state.
      ctrl: controls.
      steps: number of time steps; the size of the program does not depend on it.

    Returns:
      The last step, with the combined status of all steps.
    """

    def body(found: Step, _):
        now = whole_step(model, found.after, ctrl)
        return now.replace(status=found.status.then(now.status)), None

    # The initial values of the loop are overwritten by the first step.
    status = Status.empty(state.qpos.dtype)
    start = Step(state, state, jnp.zeros_like(state.qvel), status)
    return lax.scan(body, start, length=steps)[0]
