"""Semi-implicit Euler with implicit joint damping."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.constraint.laws import ON_VELOCITIES, RIGID
from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators import ballistic
from jaxsim.engine.integrators.advance import semi_implicit
from jaxsim.engine.integrators.damped import solve_damped
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.forces.damper import damps_dofs, dof_damping_slope
from jaxsim.forces.derivatives import Damping
from jaxsim.model import Model, State

_EULERDAMP = mujoco.mjtDisableBit.mjDSBL_EULERDAMP
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """Semi-implicit Euler step with the acceleration of `(M + h D) qacc = force`.

    The disable flags `eulerdamp` and `damper` turn the implicit damping off. With rigid contacts
    positions advance as in `ballistic`.
    """
    if model.contact in RIGID:
        return ballistic.integrate(model, state, evaluate)
    now = evaluate(state)
    # Laws on velocities have the damping in their problem already.
    if not damps_implicitly(model) or model.contact in ON_VELOCITIES:
        return semi_implicit(model, state, now, now.qacc)
    damping = Damping(dof_damping_slope(model, state.qvel), None, None)
    return semi_implicit(model, state, now, _damped(model, now, damping))


def damps_implicitly(model: Model) -> bool:
    """Whether joints may have damping, and no flag makes it explicit."""
    disabled = model.opt.disabled(_EULERDAMP) or model.opt.disabled(_DAMPER)
    return bool(model.nv) and not disabled and damps_dofs(model) is not False


def _damped(model: Model, now: Instant, damping: Damping) -> Float[Array, "nv"]:
    """Acceleration with implicit damping; exactly `qacc`, with its derivative, where D is zero.

    Forces of stiff constraints are less accurate than the acceleration, whose rounding errors they
    amplify. So if D is zero, the acceleration is not computed from forces again, as in MuJoCo.
    """
    if damps_dofs(model):
        return solve_damped(model, now, damping, now.force)
    damps = jnp.any(damping.diagonal > 0)
    change = -model.opt.timestep * damping.diagonal * now.qacc
    found = solve_damped(model, now, damping, jnp.where(damps, now.force, change))
    return jnp.where(damps, found, now.qacc + found)
