"""Integrators: from a state to the next one. One file for each, one line in `INTEGRATORS`."""

import mujoco

from jaxsim.engine.integrators.euler import euler
from jaxsim.engine.integrators.implicit import implicit
from jaxsim.engine.integrators.implicit_fast import implicit_fast
from jaxsim.engine.integrators.integrator import Integrator, Step
from jaxsim.engine.integrators.runge_kutta import runge_kutta

# By the number that `model.opt.integrator` holds, `mujoco.mjtIntegrator`.
INTEGRATORS: dict[int, Integrator] = {
    int(mujoco.mjtIntegrator.mjINT_EULER): euler,
    int(mujoco.mjtIntegrator.mjINT_RK4): runge_kutta,
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): implicit,
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): implicit_fast,
}

__all__ = ["INTEGRATORS", "Integrator", "Step"]
