"""Integrator `implicitfast`: implicit in velocity, except for Coriolis forces."""

from jaxsim.engine.integrators.advance import semi_implicit
from jaxsim.engine.integrators.damped import solve_damped
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.forces.derivatives import smooth_damping
from jaxsim.forces.free_body import solve_free_bodies
from jaxsim.model import Model, State


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """`(M + h D) qacc = force` with D of passive and actuator forces.

    For single free bodies, gyroscopic forces are implicit, too, as in MuJoCo.
    """
    now = evaluate(state)
    if not model.nv:
        return semi_implicit(model, state, now, now.qacc)
    kin, vel = now.motion.kin, now.motion.vel
    damping = smooth_damping(model, kin, vel, state.qvel, now.actuation)
    qacc = solve_damped(model, now, damping, now.force)
    qacc = solve_free_bodies(model, kin, state.qvel, damping, now.force, qacc)
    return semi_implicit(model, state, now, qacc)
