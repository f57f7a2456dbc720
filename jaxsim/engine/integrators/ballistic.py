"""Steps of rigid contacts: half a step of position, the velocity, the other half.

    q_m = q + h/2 v,    v+ = v + h a(q_m, v),    q+ = q_m + h/2 v+ + d

(the leapfrog method that begins with positions). Under constant forces it is exact; with forces of
the position it is of second order, and the energy does not drift. Impacts within the step move its
end by d (`jaxsim.constraint.rigid.displacement`).
"""

from jaxsim.engine.integrators.advance import advance
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.engine.status import Status
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.model import Model, State


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """A step with impacts at their time; damping of joints is implicit."""
    h = model.opt.timestep
    middle = state.replace(qpos=integrate_pos(model, state.qpos, state.qvel, 0.5 * h))
    now = evaluate(middle, 0.5 * h)
    rate = 0.5 * (state.qvel + h * now.qacc)
    if now.constrained.displacement is not None:
        rate = rate + now.constrained.displacement / h
    acting = now.actuation
    after = advance(model, middle, now.qacc, acting.act_dot, acting.paths, rate)
    return Step(after, state, now.qacc, Status.of(now.constrained), now.readings)
