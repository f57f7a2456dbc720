"""Semi-implicit Euler, with the damping of joints implicit."""

import mujoco

from jaxsim.engine.integrators.advance import semi_implicit
from jaxsim.engine.integrators.damped import solve_damped
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.forces.damper import dof_damping_slope
from jaxsim.forces.derivatives import Damping
from jaxsim.model import Model, State

_EULERDAMP = mujoco.mjtDisableBit.mjDSBL_EULERDAMP
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """`(M + h D) qacc = force`; the new velocity moves the positions.

    The flags `eulerdamp` and `damper` switch the implicit damping off.
    """
    now = evaluate(state)
    explicit = model.opt.disabled(_EULERDAMP) or model.opt.disabled(_DAMPER)
    if not model.nv or explicit:
        return semi_implicit(model, state, now, now.qacc)
    damping = Damping(dof_damping_slope(model, state.qvel), None, None)
    return semi_implicit(model, state, now, solve_damped(model, now, damping))
