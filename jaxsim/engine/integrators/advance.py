"""The last part of all integrators: advance the state with constant rates."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.running_sum import add_rounding_up
from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators.integrator import Step
from jaxsim.engine.status import Status
from jaxsim.forces.activation import activation_rows, next_activation
from jaxsim.forces.actuation import Paths, disabled_actuators
from jaxsim.forces.orientation import canonical_setpoints
from jaxsim.forces.servo import integrated_setpoints, nearest_setpoint
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.model import Model, State

_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION


def semi_implicit(model: Model, state: State, now: Instant, qacc: Float[Array, "nv"]) -> Step:
    """A semi-implicit Euler step: positions advance with the new velocity.

    Args:
      model: the model.
      state: the state.
      now: forces and acceleration of the state.
      qacc: acceleration of the step.
    """
    acting = now.actuation
    after = advance(model, state, qacc, acting.act_dot, acting.paths)
    return Step(after, state, now.qacc, Status.of(now.constrained), now.readings)


def advance(
    model: Model,
    state: State,
    qacc: Float[Array, "nv"],
    act_dot: Float[Array, "na"],
    paths: Paths,
    qvel: Float[Array, "nv"] | None = None,
) -> State:
    """The state after a time step with constant rates.

    Args:
      model: the model.
      state: the state.
      qacc: rate of the velocities.
      act_dot: rates of the activations.
      paths: lengths of the actuators, near which setpoints of rotation servos stay, and rates.
      qvel: velocity with which positions advance; None for the velocity after the step.
    """
    h = model.opt.timestep
    after = state.qvel + h * qacc
    time, excess = add_rounding_up(state.time, state.time_excess, h)
    return state.replace(
        qpos=integrate_pos(model, state.qpos, after if qvel is None else qvel, h),
        qvel=after,
        act=next_activations(model, state.act, act_dot, paths),
        time=time,
        time_excess=excess,
    )


def next_activations(
    model: Model,
    act: Float[Array, "na"],
    act_dot: Float[Array, "na"],
    paths: Paths,
) -> Float[Array, "na"]:
    """Next activations; constant for disabled actuators, wrapped for servos of rotations."""
    if not model.na or model.opt.disabled(_ACTUATION):
        return act
    length, velocity = paths
    rate = jnp.where(disabled_actuators(model)[model.structure.act_actuator], 0, act_dot)
    after = next_activation(model, act, rate, velocity, model.opt.timestep)
    if len(ids := integrated_setpoints(model)):
        rows, near = activation_rows(model, ids), take(length, model.actuator_outadr[ids])
        wrapped = nearest_setpoint(model, ids, take(after, rows), near)
        after = after.at[rows].set(wrapped, unique_indices=True)
    return canonical_setpoints(model, after)
