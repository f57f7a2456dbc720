"""Semi-implicit Euler, with the damping of joints implicit."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators.advance import semi_implicit
from jaxsim.engine.integrators.damped import solve_damped
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.forces.damper import damps_dofs, dof_damping_slope
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
    if not model.nv or explicit or damps_dofs(model) is False:
        return semi_implicit(model, state, now, now.qacc)
    damping = Damping(dof_damping_slope(model, state.qvel), None, None)
    return semi_implicit(model, state, now, _damped(model, now, damping))


def _damped(model: Model, now: Instant, damping: Damping) -> Float[Array, "nv"]:
    """`qacc` itself where D is zero, in value and derivative.

    Forces of stiff constraints are known less well than the acceleration, whose rounding they
    amplify. So without D they are not divided by M again; MuJoCo does not, either.
    """
    if damps_dofs(model):
        return solve_damped(model, now, damping, now.force)
    damps = jnp.any(damping.diagonal > 0)
    change = -model.opt.timestep * damping.diagonal * now.qacc
    found = solve_damped(model, now, damping, jnp.where(damps, now.force, change))
    return jnp.where(damps, found, now.qacc + found)
