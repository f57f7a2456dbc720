"""The classical Runge-Kutta method of fourth order, for configurations that form a Lie group."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.engine.delays import aged, remembers_sensors
from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators.advance import advance
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.engine.status import Status
from jaxsim.joints.coordinates import exponential_rate, integrate_pos
from jaxsim.model import Model, State

# Time of each stage as a fraction of the step, and its weight.
_TABLEAU = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """Classical Runge-Kutta of fourth order in the Lie group of the configurations.

    During the step a rotation is `q exp(theta)`, and the method averages rates of theta, not
    angular velocities (Munthe-Kaas 1999; Hairer, Lubich and Wanner, Geometric Numerical
    Integration, section IV.8). With `model.rotations` "mujoco" it averages angular velocities as
    MuJoCo does, which is of second order for rotations. Without ball and free joints both are
    equal.
    """
    h, dtype = model.opt.timestep, state.qpos.dtype

    def stage(carry, fraction_and_weight):
        (rate, slope, act_dot), total, _, _, status, readings = carry
        fraction, weight = fraction_and_weight
        theta = h * fraction * rate
        # Each solve starts from the acceleration of the last stage; see `stepping.whole_step`.
        at = state.replace(
            qacc_warmstart=lax.stop_gradient(slope),
            qpos=integrate_pos(model, state.qpos, theta, 1.0),
            qvel=state.qvel + h * fraction * slope,
            act=state.act + h * fraction * act_dot,
            time=state.time + h * fraction,
            history=aged(model, state.history, h * fraction),
        )
        then = evaluate(at)
        derivative = _derivative(model, at, then, theta)
        total = jax.tree.map(lambda a, b: a + weight * b, total, derivative)
        status = status.then(Status.of(then.constrained))
        if readings is not None and then.readings is not None:
            readings = jnp.where(fraction == 0, then.readings, readings)
        return (derivative, total, then.actuation.paths, at, status, readings), None

    # One loop body for all stages keeps the program small; the first stage has offset zero.
    start = (jnp.zeros_like(state.qvel), state.qacc_warmstart, jnp.zeros_like(state.act))
    paths = (jnp.zeros(model.nout, dtype), jnp.zeros(model.nout, dtype))
    zeros = jax.tree.map(jnp.zeros_like, start)
    readings = jnp.zeros(model.nsensordata, dtype) if remembers_sensors(model) else None
    carry = (start, zeros, paths, state, Status.empty(dtype), readings)
    found, _ = lax.scan(stage, carry, jnp.asarray(_TABLEAU, dtype))
    (_, qacc, _), total, paths, last, status, readings = found
    mean_rate, mean_qacc, mean_act_dot = jax.tree.map(lambda x: x / 6, total)
    after = advance(model, state, mean_qacc, mean_act_dot, paths, mean_rate)
    return Step(after, last, qacc, status, readings)


def _derivative(model: Model, at: State, then: Instant, theta: Float[Array, "nv"]):
    """Rates of exponential coordinates, velocities and activations."""
    lie = model.rotations == "lie"
    moving = exponential_rate(model, at.qvel, theta) if lie else at.qvel
    return moving, then.qacc, then.actuation.act_dot
