"""`check`: raise an error on the host for problems that compiled code has reported as data."""

import jax
import numpy as np

from jaxsim.engine.report import Forward
from jaxsim.engine.status import Status
from jaxsim.model import JaxsimError, State


class SimulationError(JaxsimError, RuntimeError):
    """A simulation failed; the message says why and what to do."""


def check(result: State | Forward | Status) -> None:
    """Raise an error if a result, of one environment or of a batch, shows a problem.

    Call it on the host, not inside `jit`.

    Args:
      result: a state, a result of `forward`, or a status of `step_with_status` or `rollout`.

    Raises:
      SimulationError: some numbers are not finite, contacts were lost because there were too few
        slots, or conjugate gradients ran out of iterations. Newton's method may run out of
        iterations without an error, because models may ask for as few as one.
      TypeError: the result is of another type.
    """
    if isinstance(result, State):
        _check_finite(result.qpos, result.qvel, result.act)
    elif isinstance(result, Forward):
        _check_finite(result.qacc)
        check(result.status)
    elif isinstance(result, Status):
        _check_status(result)
    else:
        raise TypeError(f"check takes a State, a Forward or a Status, got {type(result).__name__}")


def _check_finite(*arrays: jax.Array) -> None:
    flat = [np.asarray(a) for a in arrays]
    bad = sum(~np.isfinite(a).all(axis=-1) for a in flat) > 0
    if np.any(bad):
        raise SimulationError(
            f"{int(np.sum(bad))} of {np.size(bad)} environments have numbers that are not finite; "
            "use a smaller timestep, softer contacts (a larger solref time constant) or more "
            "armature"
        )


def _check_status(status: Status) -> None:
    lost = np.asarray(status.contact_overflow)
    if lost.max(initial=0) > 0:
        raise SimulationError(
            f"up to {int(lost.max())} contacts found no slot in {int((lost > 0).sum())} of "
            f"{lost.size} environments; load the model with a larger max_contacts or max_geom_pairs"
        )
    bad = ~np.asarray(status.finite)
    if bad.any():
        raise SimulationError(
            f"{int(bad.sum())} of {bad.size} environments met numbers that are not finite; use a "
            "smaller timestep, or check the controls, and masses of many orders of magnitude"
        )
    short = ~np.asarray(status.cg_converged)
    if short.any():
        raise SimulationError(
            f"conjugate gradients ran out of iterations in {int(short.sum())} of {short.size} "
            "environments; load the model with hessian='dense', or check masses of many orders of "
            "magnitude"
        )
