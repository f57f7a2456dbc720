"""From the acceleration of a time step to that of the instant, for discrete inverse dynamics.

An integrator that treats damping D implicitly advances the velocity by the acceleration of
`(M + h D) qacc = force`, where the force is M times the acceleration of the instant (MuJoCo
documentation, chapter "Computation", section "Inverse dynamics").
"""

import mujoco
from jaxtyping import Array, Float

from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.motion import Motion
from jaxsim.engine.integrators.euler import damps_implicitly
from jaxsim.forces.actuation import Actuation
from jaxsim.forces.damper import dof_damping_slope
from jaxsim.forces.derivatives import bias_derivative, damping_matrix, smooth_damping
from jaxsim.forces.free_body import multiply_free_bodies
from jaxsim.model import ModelError

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)


def instant_acceleration(
    motion: Motion, actuation: Actuation, qacc: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """The acceleration before a step, from that of the step, `M^-1 (M + h D) qacc`.

    Args:
      motion: position and velocity before the step.
      actuation: state of the actuators, on whose slopes the implicit integrators depend.
      qacc: change of the velocity over the step, divided by its length.

    Raises:
      ModelError: the integrator is Runge-Kutta's.
    """
    model, kin, h = motion.model, motion.kin, motion.model.opt.timestep
    if model.opt.integrator == _RK4:
        raise ModelError(
            "the flag invdiscrete has no meaning with integrator RK4, whose steps have four "
            "accelerations; use one of euler, implicit, implicitfast"
        )
    if model.opt.integrator == _EULER:
        if not damps_implicitly(model):
            return qacc
        return qacc + solve_mass(model, kin, h * dof_damping_slope(model, motion.qvel) * qacc)
    damping = smooth_damping(model, kin, motion.vel, motion.qvel, actuation)
    slope = damping_matrix(model, kin, damping)
    if model.opt.integrator == _IMPLICIT:
        slope = slope + bias_derivative(model, kin, motion.qvel)
        return qacc + solve_mass(model, kin, h * slope @ qacc)
    force = (composite_mass_matrix(model, kin) + h * (slope + slope.T) / 2) @ qacc
    force = multiply_free_bodies(model, kin, motion.qvel, damping, qacc, force)
    return solve_mass(model, kin, force)
