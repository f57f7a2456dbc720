"""One time step, from what is known at an instant to the next state.

`integrate` uses the method that the model asks for. All methods but Runge-Kutta are
semi-implicit: the new velocity moves the positions.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import mujoco
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.dynamics.aba import solve_articulated
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.velocity import Velocities
from jaxsim.forces.activation import next_activation, stateful_actuators
from jaxsim.forces.actuation import Actuation, disabled_actuators
from jaxsim.forces.damper import dof_damping_slope
from jaxsim.forces.derivatives import Damping, bias_derivative, damping_matrix, smooth_damping
from jaxsim.forces.free_body import solve_free_bodies
from jaxsim.forces.servo import wrap_setpoint
from jaxsim.joints.coordinates import exponential_rate, integrate_pos
from jaxsim.model import Model, State

_EULERDAMP = mujoco.mjtDisableBit.mjDSBL_EULERDAMP
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER
_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
_IMPLICITFAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


@struct.dataclass
class Instant:
    """What the integrators need to know about a state.

    Attributes:
      kin: its kinematics.
      vel: its link velocities.
      actuation: what the actuators do.
      force: all generalised forces but the bias added, minus the bias: what `M qacc` is.
      qacc: acceleration.
    """

    kin: Kinematics
    vel: Velocities
    actuation: Actuation
    force: Float[Array, "nv"]
    qacc: Float[Array, "nv"]


@struct.dataclass
class Step:
    """A time step: where it ends, and where forces were evaluated last.

    `mj_step` leaves the derived quantities of its last evaluation in `mjData`: those of the state
    before the step, or of the fourth stage of Runge-Kutta.

    Attributes:
      after: the next state.
      last: the state at which forces were evaluated last.
      qacc: acceleration there.
    """

    after: State
    last: State
    qacc: Float[Array, "nv"]


def integrate(
    model: Model, state: State, now: Instant, evaluate: Callable[[State], Instant]
) -> State:
    """The state one time step later.

    Args:
      model: the model; `model.opt.integrator` says how.
      state: the state.
      now: what is known about it.
      evaluate: function that gives the same for another state; Runge-Kutta needs it.
    """
    return integrate_step(model, state, now, evaluate).after


def integrate_step(
    model: Model, state: State, now: Instant, evaluate: Callable[[State], Instant]
) -> Step:
    """`integrate`, and where forces were evaluated last."""
    if model.opt.integrator == _RK4:
        return runge_kutta(model, state, now, evaluate)
    if model.opt.integrator == _IMPLICIT:
        after = implicit(model, state, now)
    elif model.opt.integrator == _IMPLICITFAST:
        after = implicit_fast(model, state, now)
    else:
        after = euler(model, state, now)
    return Step(after, state, now.qacc)


def euler(model: Model, state: State, now: Instant) -> State:
    """Semi-implicit Euler, with the damping of joints implicit: `(M + h D) qacc = force`.

    The flags `eulerdamp` and `damper` switch the implicit damping off.
    """
    qacc = now.qacc
    if model.nv and not (model.opt.disabled(_EULERDAMP) or model.opt.disabled(_DAMPER)):
        damping = Damping(dof_damping_slope(model, state.qvel), None, None)
        qacc = _solve_damped(model, now, damping)
    return advance(model, state, qacc, now.actuation)


def implicit_fast(model: Model, state: State, now: Instant) -> State:
    """Implicit in the velocity dependence of passive and actuator forces.

    Free bodies that carry nothing have their gyroscopic forces implicit too, as in MuJoCo.
    """
    if not model.nv:
        return advance(model, state, now.qacc, now.actuation)
    damping = smooth_damping(model, now.kin, now.vel, state.qvel, now.actuation)
    qacc = _solve_damped(model, now, damping)
    qacc = solve_free_bodies(model, now.kin, state.qvel, damping, now.force, qacc)
    return advance(model, state, qacc, now.actuation)


def implicit(model: Model, state: State, now: Instant) -> State:
    """Implicit in the velocity dependence of all smooth forces, Coriolis forces included."""
    if not model.nv:
        return advance(model, state, now.qacc, now.actuation)
    damping = smooth_damping(model, now.kin, now.vel, state.qvel, now.actuation)
    slope = damping_matrix(model, now.kin, damping) + bias_derivative(model, now.kin, state.qvel)
    matrix = composite_mass_matrix(model, now.kin) + model.opt.timestep * slope
    return advance(model, state, jnp.linalg.solve(matrix, now.force), now.actuation)


def runge_kutta(
    model: Model, state: State, now: Instant, evaluate: Callable[[State], Instant]
) -> Step:
    """Classical Runge-Kutta of fourth order in the Lie group of the configurations.

    A rotation during the step is `q exp(theta)`, and what the stages average is the rate of
    theta, not the angular velocity (Munthe-Kaas 1999; Hairer, Lubich and Wanner, Geometric
    Numerical Integration, section IV.8). MuJoCo averages angular velocities, which has second
    order for rotations, and so do we if `model.rotations` is "mujoco"; without ball and free joints
    both are the same.
    """
    h = model.opt.timestep

    def stage(carry, fraction_and_weight):
        (rate, slope, act_dot), total, _, _ = carry
        fraction, weight = fraction_and_weight
        theta = h * fraction * rate
        # The solver starts from the last stage's acceleration; see `jaxsim.engine.step.whole_step`.
        at = state.replace(
            qacc_warmstart=lax.stop_gradient(slope),
            qpos=integrate_pos(model, state.qpos, theta, 1.0),
            qvel=state.qvel + h * fraction * slope,
            act=state.act + h * fraction * act_dot,
            time=state.time + h * fraction,
        )
        then = evaluate(at)
        lie = model.rotations == "lie"
        moving = exponential_rate(model, at.qvel, theta) if lie else at.qvel
        derivative = _derivative(then, moving)
        total = jax.tree.map(lambda a, b: a + weight * b, total, derivative)
        return (derivative, total, then.actuation.actuator_length, at), None

    # One body for all stages keeps the program small; the first one stays where the state is.
    tableau = jnp.asarray([[0.0, 1.0], [0.5, 2.0], [0.5, 2.0], [1.0, 1.0]], h.dtype)
    start = (jnp.zeros_like(state.qvel), state.qacc_warmstart, jnp.zeros_like(state.act))
    carry = (start, jax.tree.map(jnp.zeros_like, start), now.actuation.actuator_length, state)
    ((_, last, _), total, length, at), _ = lax.scan(stage, carry, tableau)
    rate, qacc, act_dot = jax.tree.map(lambda x: x / 6, total)
    transmission = now.actuation.transmission.replace(length=length)
    actuation = now.actuation.replace(transmission=transmission, act_dot=act_dot)
    return Step(advance(model, state, qacc, actuation, rate), at, last)


def advance(
    model: Model,
    state: State,
    qacc: Float[Array, "nv"],
    actuation: Actuation,
    qvel: Float[Array, "nv"] | None = None,
) -> State:
    """Move on by a time step with constant acceleration and rates.

    Args:
      model: the model.
      state: the state.
      qacc: acceleration.
      actuation: gives the rates of the activations.
      qvel: velocity that moves the positions; None for the one after the step.

    Returns:
      The next state; `qacc_warmstart` is the caller's business.
    """
    h = model.opt.timestep
    after = state.qvel + h * qacc
    return state.replace(
        qpos=integrate_pos(model, state.qpos, after if qvel is None else qvel, h),
        qvel=after,
        act=_advance_activation(model, state.act, actuation),
        time=state.time + h,
    )


def _advance_activation(model: Model, act, actuation: Actuation) -> Float[Array, "na"]:
    """Activations stand still where actuators are off; those of rotation servos stay bounded."""
    ids = stateful_actuators(model)
    if not len(ids) or model.opt.disabled(_ACTUATION):
        return act
    rate = jnp.where(disabled_actuators(model)[ids], 0, actuation.act_dot)
    after = next_activation(model, act, rate, model.opt.timestep)
    spread = actuation.actuator_length.at[ids].set(after)
    return take(wrap_setpoint(model, spread, actuation.actuator_length), ids)


def _solve_damped(model: Model, now: Instant, damping: Damping) -> Float[Array, "nv"]:
    """`(M + h D)^-1 force`: O(n) along the tree unless D couples more than the tree does."""
    h = model.opt.timestep
    if damping.dense is not None:
        matrix = composite_mass_matrix(model, now.kin) + h * damping_matrix(model, now.kin, damping)
        return jnp.linalg.solve(matrix, now.force)
    links = jax.vmap(lambda inertia: inertia.as_matrix())(now.kin.inertia)
    if damping.link_matrix is not None:
        links = links + h * damping.link_matrix
    diagonal = dof_armature(model) + h * damping.diagonal
    return solve_articulated(model, now.kin.cdof, links, diagonal, now.force)


def _derivative(at: Instant, rate: Float[Array, "nv"]):
    """Rates of the coordinates, velocities and activations."""
    return rate, at.qacc, at.actuation.act_dot
