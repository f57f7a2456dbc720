"""Integrators: from a state to the next. Each is one file and one line in `INTEGRATORS`."""

import mujoco

from jaxsim.engine.integrators import euler, implicit, implicit_fast, runge_kutta
from jaxsim.engine.integrators.integrator import Integrator, Step

# By `model.opt.integrator`, a number of `mujoco.mjtIntegrator`.
INTEGRATORS: dict[int, Integrator] = {
    int(mujoco.mjtIntegrator.mjINT_EULER): euler.integrate,
    int(mujoco.mjtIntegrator.mjINT_RK4): runge_kutta.integrate,
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): implicit.integrate,
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): implicit_fast.integrate,
}

__all__ = ["INTEGRATORS", "Integrator", "Step"]
