"""Several shorter steps in place of one, and the phase at which they begin."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.engine.stepping import step
from jaxsim.model import Model, State


def substeps(
    model: Model,
    state: State,
    ctrl: Float[Array, "nu"] | None = None,
    *,
    count: int,
    phase: float | Float[Array, ""] | None = None,
) -> State:
    """One time step of the model's length as `count` shorter ones, under constant controls.

    With a random phase, contacts begin at a random part of a sub-step, and the mean of gradients
    over phases does not depend on where one happened to begin.

    Args:
      model: the model; its timestep is the length of all sub-steps together.
      state: the state.
      ctrl: controls; None means zeros.
      count: number of sub-steps, at least one.
      phase: between 0 and 1, exclusive: the first sub-step has this share of the length of the
        others, and one more at the end has the rest. None: all are equally long.

    Returns:
      The next state.

    Raises:
      ValueError: `count` is less than one, or an argument of `step` is wrong.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    if model.nhistory:
        raise ValueError("the model has delays, whose samples are whole time steps apart; use step")
    shares = jnp.ones(count)
    if phase is not None:
        shares = jnp.ones(count + 1).at[0].set(phase).at[-1].set(1 - jnp.asarray(phase))
    lengths = shares.astype(state.qpos.dtype) / count * model.opt.timestep

    def body(state, length):
        opt = model.opt.replace(timestep=length)
        return step(model.replace(opt=opt), state, ctrl), None

    return lax.scan(checkpoint(body), state, lengths)[0]
