"""Activations: the states of actuators that have dynamics."""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import take
from jaxsim.arrays.kinds import apply_by_kind
from jaxsim.forces.muscle import muscle_activation_rate
from jaxsim.model import Model

_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FILTER = int(mujoco.mjtDyn.mjDYN_FILTER)
_FILTEREXACT = int(mujoco.mjtDyn.mjDYN_FILTEREXACT)
_MUSCLE = int(mujoco.mjtDyn.mjDYN_MUSCLE)


def stateful_actuators(model: Model) -> np.ndarray:
    """(na,) actuator of each activation; static."""
    (ids,) = np.nonzero(model.actuator_actadr >= 0)
    return ids[np.argsort(model.actuator_actadr[ids])]


def activation_rate(
    model: Model, act: Float[Array, "na"], ctrl: Float[Array, "nu"]
) -> Float[Array, "na"]:
    """Rates of the activations.

    They are `ctrl` for integrators, `(ctrl - act) / tau` for filters, and for muscles the same
    with a time constant that depends on `ctrl` and `act`.

    Args:
      model: the model.
      act: activations.
      ctrl: controls, clamped to their ranges.
    """
    ids = stateful_actuators(model)
    if not len(ids):
        return jnp.zeros_like(act)

    def lag(u, a, prm):
        return (u - a) / jnp.maximum(prm[0], MINVAL)

    kinds = {
        _INTEGRATOR: lambda u, a, prm: u,
        _FILTER: lag,
        _FILTEREXACT: lag,
        _MUSCLE: muscle_activation_rate,
    }
    prm = take(model.actuator_dynprm, ids)
    return apply_by_kind(model.actuator_dyntype[ids], kinds, take(ctrl, ids), act, prm, empty=act)


def next_activation(
    model: Model,
    act: Float[Array, "na"],
    act_dot: Float[Array, "na"],
    dt: Float[Array, ""],
) -> Float[Array, "na"]:
    """Activations after a time step, within `actrange`.

    This is an Euler step. For exact filters its length is `tau (1 - exp(-dt / tau))` instead of dt.

    Args:
      model: the model.
      act: activations.
      act_dot: their rates.
      dt: length of the time step (s).
    """
    ids = stateful_actuators(model)
    if not len(ids):
        return act
    step = dt * jnp.ones_like(act)
    exact = model.actuator_dyntype[ids] == _FILTEREXACT
    if exact.any():
        tau = jnp.maximum(take(model.actuator_dynprm[:, 0], ids), MINVAL)
        step = jnp.where(exact, -tau * jnp.expm1(-dt / jnp.where(exact, tau, 1.0)), step)
    stepped = act + act_dot * step
    limited = np.asarray(model.actuator_actlimited, bool)[ids]
    if not limited.any():
        return stepped
    low, high = take(model.actuator_actrange, ids).T
    return jnp.where(limited, jnp.clip(stepped, low, high), stepped)
