"""`step` and `rollout`: pure functions of one environment.

kinematics -> inertia and bias -> forces -> contacts -> convex problem -> acceleration -> integrate
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.arrays.finite import zero_if_finite
from jaxsim.arrays.memo import is_traced
from jaxsim.arrays.precision import full_precision
from jaxsim.arrays.whole import as_a_whole
from jaxsim.collision import Contact, detect, model_candidates
from jaxsim.constraint import constrained_acceleration, with_entry_times
from jaxsim.dynamics.motion import Motion, motion_of
from jaxsim.dynamics.rnea import bias_forces, generalized_force, wrench_on_links
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia, tendon_bias
from jaxsim.engine.delays import applied_controls, next_history, remembers_sensors
from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators import INTEGRATORS, Step
from jaxsim.engine.kernels import steps_are_kernels
from jaxsim.engine.readout import energies, read_sensors
from jaxsim.engine.status import Status
from jaxsim.forces.actuation import Actuation, actuation
from jaxsim.forces.passive import PassiveForces, passive_forces
from jaxsim.lanes import as_kernel, with_pullback_kernel
from jaxsim.model import Model, State
from jaxsim.model.inputs import admit, admit_array


@full_precision
def step(model: Model, state: State, ctrl: Float[Array, "nu"] | None = None) -> State:
    """Advance one environment by one timestep.

    Args:
      model: the model.
      state: the state; make one with `make_state`.
      ctrl: controls; None means zeros.

    Returns:
      The next state. Its numbers are NaN if the step was not finite.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    return whole_step(model, state, ctrl).after


def step_with_status(
    model: Model, state: State, ctrl: Float[Array, "nu"] | None = None
) -> tuple[State, Status]:
    """`step`, and the status of its solves: iterations, convergence, lost contacts, finite numbers.

    Combine the statuses of several steps with `Status.then`. Under `jax.jit`, parts of a status
    that are not used cost nothing.

    Args:
      model: the model.
      state: the state.
      ctrl: controls; None means zeros.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    found = whole_step(model, state, ctrl)
    return found.after, found.status


@full_precision
def whole_step(model: Model, state: State, ctrl: Float[Array, "nu"] | None = None) -> Step:
    """`step` as a `Step`: with its status and the state at which forces were evaluated last."""
    model, state, ctrl = admit(model, state, ctrl)
    advance = functools.partial(_step, model)
    if steps_are_kernels(model) and is_traced((state, ctrl)):
        by_kernel = with_pullback_kernel if model.backward.reverse_only else as_kernel
        advance = by_kernel(functools.partial(_guarded_step, model), finite_math=True)
    return advance(state, ctrl)


@as_a_whole
def _step(model: Model, state: State, ctrl: Float[Array, "nu"] | None) -> Step:
    integrate = INTEGRATORS[model.opt.integrator]
    evaluate = functools.partial(_evaluate_for_step, model, ctrl)
    # A kernel's pullback keeps no more than the state between the stages of an integrator.
    evaluate = jax.checkpoint(evaluate) if model.backward.reverse_only else evaluate
    found = integrate(model, state, evaluate)
    after = found.after
    numbers = jnp.concatenate([after.qpos, after.qvel, after.act])
    return found.replace(
        # The warm start affects how fast the solution is found, not the solution.
        after=after.replace(
            qacc_warmstart=lax.stop_gradient(found.qacc),
            history=next_history(model, state, ctrl, found.readings),
        ),
        readings=None,
        status=found.status.replace(finite=found.status.finite & jnp.isfinite(numbers).all()),
    )


def _guarded_step(model: Model, state: State, ctrl: Float[Array, "nu"] | None) -> Step:
    """`_step` for finite math, which may lose a NaN: the result has one if an argument has."""
    # The solver recovers from a bad warm start, and the time moves nothing.
    nothing = zero_if_finite((state.replace(qacc_warmstart=(), time=(), time_excess=()), ctrl))
    found = _step(model, state, ctrl)
    after, finite = found.after, found.status.finite & (nothing == 0)
    return found.replace(
        after=after.replace(
            qpos=after.qpos + nothing,
            qvel=after.qvel + nothing,
            act=after.act + nothing,
            qacc_warmstart=after.qacc_warmstart + nothing,
        ),
        status=found.status.replace(finite=finite),
    )


def _evaluate_for_step(
    model: Model,
    ctrl: Float[Array, "nu"] | None,
    state: State,
    ahead: Float[Array, ""] | None = None,
) -> Instant:
    now = evaluate(model, state, ctrl, ahead)
    if remembers_sensors(model):
        now = now.replace(readings=read_sensors(now, state, energies(now, state)))
    if not model.backward.entry_time:
        return now
    return now.replace(constrained=with_entry_times(now.motion, now.constrained, now.qfrc_smooth))


def evaluate(
    model: Model,
    state: State,
    ctrl: Float[Array, "nu"] | None,
    ahead: Float[Array, ""] | None = None,
) -> Instant:
    """Forces, contacts and accelerations of a state.

    Args:
      model: the model.
      state: the state.
      ctrl: controls; None means zeros.
      ahead: time by which positions are ahead of velocities (s); None for none.
    """
    motion = motion_of(model, state, ahead)
    kin, vel = motion.kin, motion.vel
    bias, own_bias = bias_forces(model, kin, vel)
    touching = contacts(motion)
    passive, actuators = forces(motion, state, ctrl, touching)
    # One sum over the tree for both the applied and the inertial wrenches.
    on_links = generalized_force(model, kin, applied_wrench(motion, state) - bias) - own_bias
    total = passive.qfrc_passive + actuators.qfrc_actuator + state.qfrc_applied + on_links
    if has_tendon_inertia(model):
        total = total - tendon_bias(model, kin, vel)
    found = constrained_acceleration(motion, touching, total, state.qacc_warmstart)
    return Instant(motion, passive, actuators, total, found)


def forces(
    motion: Motion,
    state: State,
    ctrl: Float[Array, "nu"] | None,
    contact: Contact | None = None,
) -> tuple[PassiveForces, Actuation]:
    """Passive forces and the state of the actuators."""
    model, kin = motion.model, motion.kin
    passive = passive_forces(model, kin, motion.vel, state.qpos, state.qvel, contact)
    ctrl = applied_controls(model, state, ctrl)
    coordinates, gravcomp = (state.qpos, state.qvel, state.act), passive.qfrc_gravcomp
    actuators = actuation(model, kin, *coordinates, ctrl, gravcomp, contact, state.time)
    return passive, actuators


def applied_wrench(motion: Motion, state: State) -> Float[Array, "njnt 6"]:
    """Wrenches on the links by `xfrc_applied`."""
    wrench = jnp.concatenate([state.xfrc_applied[:, 3:], state.xfrc_applied[:, :3]], axis=1)
    return wrench_on_links(motion.model, motion.kin, wrench, motion.kin.xipos)


def contacts(motion: Motion) -> Contact:
    """The contacts of a position."""
    model, kin = motion.model, motion.kin
    return detect(model, model_candidates(model), kin.geom_xpos, kin.geom_xmat)


@full_precision
def rollout(
    model: Model, state: State, ctrls: Float[Array, "T nu"], *, status: bool = False
) -> tuple[State, State] | tuple[State, State, Status]:
    """`step` over a sequence of controls, as one `lax.scan`.

    Args:
      model: the model.
      state: initial state.
      ctrls: (T, nu) controls of each step.
      status: whether to return the status of the solves, too.

    Returns:
      The final state, and the states after each step, stacked along a leading axis. With `status`,
      also the combined status of all steps.

    Raises:
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, state, _ = admit(model, state)
    ctrls = admit_array(model, ctrls, (None, model.nu), "ctrls")
    # Close over the model: as an argument of a jitted function, its facts would be unknown.
    advance = checkpoint(lambda state, ctrl: step_with_status(model, state, ctrl))
    final, states, total = scan_steps(advance, lambda state: state, status, state, ctrls)
    return (final, states, total) if status else (final, states)


def scan_steps(
    advance: Callable[[State, Array], tuple[State, Status]],
    observe: Callable[[State], Any],
    status: bool,
    state: State,
    ctrls: Float[Array, "T nu"],
) -> tuple[State, Any, Any]:
    """The final state, the observation after each step, and the combined status if `status`."""

    def body(carry, ctrl):
        state, total = carry
        state, now = advance(state, ctrl)
        return (state, total.then(now) if status else None), observe(state)

    start = Status.empty(state.qpos.dtype) if status else None
    (final, total), seen = lax.scan(body, (state, start), ctrls)
    return final, seen, total
