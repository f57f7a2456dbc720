"""The classical Runge-Kutta method of fourth order, for configurations that form a Lie group."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators.advance import advance
from jaxsim.engine.integrators.integrator import Evaluate, Step
from jaxsim.engine.status import Status
from jaxsim.joints.coordinates import exponential_rate, integrate_pos
from jaxsim.model import Model, State

# Of each stage: how far into the step it lies, and its weight.
_TABLEAU = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))


def integrate(model: Model, state: State, evaluate: Evaluate) -> Step:
    """Classical Runge-Kutta of fourth order in the Lie group of the configurations.

    A rotation during the step is `q exp(theta)`, and what the stages average is the rate of
    theta, not the angular velocity (Munthe-Kaas 1999; Hairer, Lubich and Wanner, Geometric
    Numerical Integration, section IV.8). MuJoCo averages angular velocities, which has second
    order for rotations, and so do we if `model.rotations` is "mujoco"; without ball and free joints
    both are the same.
    """
    h, dtype = model.opt.timestep, state.qpos.dtype

    def stage(carry, fraction_and_weight):
        (rate, slope, act_dot), total, _, _, status = carry
        fraction, weight = fraction_and_weight
        theta = h * fraction * rate
        # The solver starts from the last stage's acceleration; see `stepping.whole_step`.
        at = state.replace(
            qacc_warmstart=lax.stop_gradient(slope),
            qpos=integrate_pos(model, state.qpos, theta, 1.0),
            qvel=state.qvel + h * fraction * slope,
            act=state.act + h * fraction * act_dot,
            time=state.time + h * fraction,
        )
        then = evaluate(at)
        derivative = _derivative(model, at, then, theta)
        total = jax.tree.map(lambda a, b: a + weight * b, total, derivative)
        status = status.then(Status.of(then.constrained))
        return (derivative, total, then.actuation.actuator_length, at, status), None

    # One body for all stages keeps the program small; the first one stays where the state is.
    start = (jnp.zeros_like(state.qvel), state.qacc_warmstart, jnp.zeros_like(state.act))
    length = jnp.zeros(model.nu, dtype)
    carry = (start, jax.tree.map(jnp.zeros_like, start), length, state, Status.empty(dtype))
    found, _ = lax.scan(stage, carry, jnp.asarray(_TABLEAU, dtype))
    (_, qacc, _), total, length, last, status = found
    mean_rate, mean_qacc, mean_act_dot = jax.tree.map(lambda x: x / 6, total)
    after = advance(model, state, mean_qacc, mean_act_dot, length, mean_rate)
    return Step(after, last, qacc, status)


def _derivative(model: Model, at: State, then: Instant, theta: Float[Array, "nv"]):
    """Rates of the coordinates, in exponential coordinates, of velocities and of activations."""
    lie = model.rotations == "lie"
    moving = exponential_rate(model, at.qvel, theta) if lie else at.qvel
    return moving, then.qacc, then.actuation.act_dot
