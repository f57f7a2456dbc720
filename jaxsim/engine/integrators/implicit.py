"""Integrator `implicit`: implicit in the velocity dependence of all smooth forces."""

from jaxsim.batching.matrices import solve
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.engine.integrators.advance import semi_implicit
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.forces.derivatives import bias_derivative, damping_matrix, smooth_damping
from jaxsim.model import Model, State


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """`(M + h D) qacc = force` with D of all smooth forces, Coriolis forces included."""
    now = evaluate(state)
    if not model.nv:
        return semi_implicit(model, state, now, now.qacc)
    kin, vel = now.motion.kin, now.motion.vel
    damping = smooth_damping(model, kin, vel, state.qvel, now.actuation)
    slope = damping_matrix(model, kin, damping) + bias_derivative(model, kin, state.qvel)
    matrix = composite_mass_matrix(model, kin) + model.opt.timestep * slope
    return semi_implicit(model, state, now, solve(matrix, now.force))
