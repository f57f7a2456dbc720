"""`Problem`: what is to be optimised.

    minimise   sum_t running_cost(x_t, u_t, t) + final_cost(x_T)
    over u     with x_{t+1} = step(x_t, u_t), x_0 = start, low <= u_t <= high,
                    state_limits(x_t) <= 0,  0 <= a_t, 0 <= b_t, a_t b_t = 0

T is the horizon. States may be of any kind that a `Space` knows how to move in.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.model import JaxsimError, Model, State, make_state
from jaxsim.trajopt.space import Space, StateSpace, VectorSpace, stack
from jaxsim.trajopt.steps import ModelSteps, steps_of

Ctrls = Float[Array, "T nu"]
Scalar = Float[Array, ""]


class ProblemError(JaxsimError, ValueError):
    """A problem, or a guess for it, makes no sense; the message says what was expected."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """An optimal control problem; made by `make_problem`, which judges it.

    Its arrays may be tracers: a function that makes a problem from a start or a model, and solves
    it, can be mapped over either by `jax.vmap`.

    Attributes:
      step: `(x, u)` to the next state.
      space: where states live.
      start: the first state.
      horizon: number of steps T.
      running_cost: `(x, u, t)` to a number, for t = 0 ... T-1.
      final_cost: `(x)` to a number, of the last state.
      low: least controls; may be infinite.
      high: greatest controls.
      frame_skip: steps of the dynamics for which a control is held.
      state_limits: `(x)` to numbers (m,) that are to be at most zero, or None.
      complementarity: `(x, u, y)` to a pair of arrays (m,), y the next state, of which no number is
        to be negative and one of each two zero; or None.
      normal_forces: `(x, u)` to the normal forces of contacts (N), where these are controls; or
        None.
    """

    step: Callable[[Any, Float[Array, "nu"]], Any]
    space: Space
    start: Any
    horizon: int
    running_cost: Callable[[Any, Float[Array, "nu"], Any], Scalar]
    final_cost: Callable[[Any], Scalar]
    low: Float[Array, "nu"]
    high: Float[Array, "nu"]
    frame_skip: int = 1
    state_limits: Callable[[Any], Float[Array, "m"]] | None = None
    complementarity: Callable[[Any, Array, Any], tuple[Array, Array]] | None = None
    normal_forces: Callable[[Any, Float[Array, "nu"]], Float[Array, "n"]] | None = None

    def replace(self, **changes: Any) -> "Problem":
        """The same problem but for some attributes."""
        return dataclasses.replace(self, **changes)

    def reverse_only(self) -> "Problem":
        """The same problem for a method that takes derivatives in reverse mode only, and once.

        Where steps of its model are kernels, so are their derivatives.
        """
        if not isinstance(self.step, ModelSteps):
            return self
        return self.replace(step=self.step.reverse_only())

    def rollout(self, ctrls: Ctrls) -> tuple[Any, Scalar]:
        """States (T+1, ...) under these controls, and their cost."""
        states, _, cost = self.follow(lambda x, u: u, ctrls)
        return states, cost

    def follow(
        self,
        policy: Callable[[Any, Any], Float[Array, "nu"]],
        inputs: Any,
        jumps: Float[Array, "T n"] | None = None,
    ) -> tuple[Any, Ctrls, Scalar]:
        """States (T+1, ...), controls and cost under `u_t = policy(x_t, inputs[t])`.

        Where there are jumps, each is a tangent vector by which a state moves after its step.
        """
        advance = checkpoint(self.step)

        def body(carry, now):
            (x, total), (t, given, jump) = carry, now
            u = policy(x, given)
            total = total + self.running_cost(x, u, t)
            x = advance(x, u)
            x = x if jump is None else self.space.retract(x, jump)
            return (x, total), (x, u)

        zero = jnp.zeros((), self.low.dtype)
        steps = jnp.arange(self.horizon)
        (last, total), (states, ctrls) = lax.scan(body, (self.start, zero), (steps, inputs, jumps))
        return stack(self.start, states), ctrls, total + self.final_cost(last)

    def total_cost(self, states: Any, ctrls: Ctrls) -> Scalar:
        """Cost of states (T+1, ...) and controls, whether or not one leads to the other."""
        before = jax.tree.map(lambda x: x[:-1], states)
        costs = jax.vmap(self.running_cost)(before, ctrls, jnp.arange(self.horizon))
        return costs.sum() + self.final_cost(jax.tree.map(lambda x: x[-1], states))

    def clip(self, ctrls: Float[Array, "*T nu"]) -> Float[Array, "*T nu"]:
        """The nearest controls within the limits."""
        shape = (1,) * (ctrls.ndim - 1) + self.low.shape
        return jnp.clip(ctrls, self.low.reshape(shape), self.high.reshape(shape))

    def random_ctrls(self, key: jax.Array, scale: float = 0.1) -> Ctrls:
        """Small random controls: normal, `scale` times half of the range, or times 1 without one.

        All zero would be a poor guess: it is a stationary point of a pendulum that hangs.
        """
        middle = (self.high + self.low) / 2
        middle = jnp.where(jnp.isfinite(middle), middle, 0)
        noise = jax.random.normal(key, (self.horizon, *self.low.shape), self.low.dtype)
        return self.clip(middle[None] + scale * self.half_range[None] * noise)

    @property
    def half_range(self) -> Float[Array, "nu"]:
        """Half of the difference of the limits; 1 where there is no such thing."""
        half = (self.high - self.low) / 2
        return jnp.where(jnp.isfinite(half), half, 1)


def make_problem(
    dynamics: Model | Callable[[Any, Array], Any],
    start: Any = None,
    *,
    horizon: int,
    running_cost: Callable[[Any, Array, Any], Any],
    final_cost: Callable[[Any], Any] = lambda x: 0.0,
    nu: int | None = None,
    control_limits: tuple[Any, Any] | None = None,
    frame_skip: int = 1,
    state_limits: Callable[[Any], Any] | None = None,
    complementarity: Callable[[Any, Array, Any], Any] | None = None,
) -> Problem:
    """An optimal control problem, judged before anything is compiled.

    Args:
      dynamics: a model, whose states are `jaxsim.State`; or a function `(x, u)` to the next state,
        an array or a pytree of arrays.
      start: the first state; by default the model's at `qpos0` and at rest.
      horizon: number of controls.
      running_cost: `(x, u, t)` to a number, with the step t from 0.
      final_cost: `(x)` to a number; nothing by default.
      nu: number of controls, where dynamics are a function and there are no limits.
      control_limits: least and greatest controls, numbers or arrays (nu,), in place of the model's.
      frame_skip: steps of the dynamics for which a control is held.
      state_limits: `(x)` to an array (m,) of numbers that are to be at most zero for every state
        but the first; see `AugmentedLagrangian`.
      complementarity: `(x, u, y)` to a pair of arrays (m,) that are complementary, such as
        distances and forces; y is the state after x. See `Direct`.

    Raises:
      ProblemError: the horizon is not positive, a cost is not a number, or shapes do not fit.
    """
    _expect(_whole(horizon) and horizon > 0, f"horizon must be a positive integer, got {horizon!r}")
    _expect(
        _whole(frame_skip) and frame_skip > 0,
        f"frame_skip must be a positive integer, got {frame_skip!r}",
    )
    space, start, nu = _system(dynamics, start, nu, control_limits)
    kind = jnp.result_type(*jax.tree.leaves(start))
    if control_limits is None and isinstance(dynamics, Model):
        control_limits = _model_limits(dynamics)
    low, high = _limits(control_limits, nu, kind)
    problem = Problem(
        step=steps_of(dynamics, frame_skip),
        space=space,
        start=start,
        horizon=int(horizon),
        running_cost=lambda x, u, t: jnp.asarray(running_cost(x, u, t), kind),
        final_cost=lambda x: jnp.asarray(final_cost(x), kind),
        low=low,
        high=high,
        frame_skip=frame_skip,
        state_limits=state_limits,
        complementarity=complementarity,
    )
    _check_cost("running_cost", running_cost, start, low, jnp.zeros((), int))
    _check_cost("final_cost", final_cost, start)
    if state_limits is not None:
        _check_limits(state_limits, start)
    if complementarity is not None:
        _check_pairs(complementarity, start, low)
    if not isinstance(dynamics, Model):
        _check_step(dynamics, start, low)
    return problem


def _system(dynamics, start, nu, limits):
    """The space, the first state and the number of controls."""
    if isinstance(dynamics, Model):
        start = make_state(dynamics) if start is None else start
        _expect(
            isinstance(start, State),
            f"start must be a jaxsim.State for a model, got {type(start).__name__}",
        )
        _expect(
            start.qpos.shape == dynamics.qpos0.shape,
            f"start.qpos must have shape {dynamics.qpos0.shape}, got {start.qpos.shape}; map over "
            "starts with jax.vmap",
        )
        _expect(dynamics.nu > 0, "the model has no actuators")
        _expect(not dynamics.nhistory, "the model has delays or intervals; load it without them")
        return StateSpace(dynamics), start, dynamics.nu
    _expect(
        callable(dynamics),
        f"dynamics must be a jaxsim.Model or a function (x, u) -> x, got {type(dynamics).__name__}",
    )
    _expect(start is not None, "dynamics that are a function need a start")
    if nu is None:
        _expect(limits is not None, "dynamics that are a function need nu or control_limits")
        nu = max(np.size(limit) for limit in limits)
    start = jax.tree.map(lambda x: jnp.asarray(x) * 1.0, start)
    return VectorSpace(ravel_pytree(start)[0].size), start, nu


def _model_limits(model: Model):
    limited = jnp.asarray(model.actuator_ctrllimited)
    low, high = model.actuator_ctrlrange[:, 0], model.actuator_ctrlrange[:, 1]
    return jnp.where(limited, low, -jnp.inf), jnp.where(limited, high, jnp.inf)


def _limits(limits, nu, kind):
    """Least and greatest controls, (nu,) each."""
    if limits is None:
        limits = (-jnp.inf, jnp.inf)
    _expect(len(limits) == 2, "control_limits must be a pair: least and greatest controls")
    for name, limit in zip(("least", "greatest"), limits, strict=True):
        _expect(
            np.shape(limit) in ((), (nu,)),
            f"the {name} of control_limits must be a number or have shape ({nu},), "
            f"got {np.shape(limit)}",
        )
    low, high = (jnp.broadcast_to(jnp.asarray(limit, kind), (nu,)) for limit in limits)
    if not isinstance(low, jax.core.Tracer) and not isinstance(high, jax.core.Tracer):
        _expect(bool((low <= high).all()), "control_limits must not have low above high")
    return low, high


def _check_cost(name, cost, *arguments):
    found = jax.eval_shape(cost, *arguments)
    shape = getattr(found, "shape", None)
    _expect(shape == (), f"{name} must return a number, got {_described(found)}")


def _check_limits(limits, start):
    found = jax.eval_shape(limits, start)
    shape = getattr(found, "shape", ())
    _expect(len(shape) == 1, f"state_limits must return an array (m,), got {_described(found)}")


def _check_pairs(pairs, start, ctrl):
    found = jax.eval_shape(pairs, start, ctrl, start)
    shapes = [getattr(x, "shape", None) for x in found] if isinstance(found, tuple | list) else []
    _expect(
        len(shapes) == 2 and shapes[0] == shapes[1] and len(shapes[0] or ()) == 1,
        f"complementarity must return a pair of arrays (m,), got {_described(found)}",
    )


def _check_step(step, start, ctrl):
    found = jax.eval_shape(step, start, ctrl)
    same = jax.tree.structure(found) == jax.tree.structure(start) and all(
        a.shape == b.shape and a.dtype == b.dtype
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(start), strict=True)
    )
    _expect(
        same,
        f"dynamics must return a state like start, {_described(start)}, got {_described(found)}",
    )


def _described(tree: Any) -> str:
    """Shapes and types of what a function returns."""
    return str(jax.tree.map(lambda x: f"{x.dtype}{list(x.shape)}", tree)).replace("'", "")


def _whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _expect(condition: bool, message: str) -> None:
    if not condition:
        raise ProblemError(message)
