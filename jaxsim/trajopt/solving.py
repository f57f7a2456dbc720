"""`solve`: a problem, a method, a plan."""

import sys
import time
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxsim.trajopt.plan import Iterate, Plan, PlanStatus
from jaxsim.trajopt.problem import Problem, ProblemError


class Method(Protocol):
    """An optimiser: how it starts, and what one iteration is. All are pure functions."""

    @property
    def iterations(self) -> int:
        """How many iterations `solve` makes at most."""
        ...

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """What there is before the first iteration."""
        ...

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """One iteration."""
        ...

    def shift(self, now: Iterate) -> Iterate:
        """The same one step later, to start from when a new state is known."""
        ...


def solve(
    problem: Problem,
    method: Method,
    ctrls: Float[Array, "T nu"] | None = None,
    *,
    key: jax.Array | None = None,
    progress: bool = False,
) -> Plan:
    """Optimise the controls of a problem.

        plan = trajopt.solve(problem, trajopt.ILQR())

    Each call compiles a program of its own; `jax.jit(lambda x: solve(problem.replace(start=x),
    method))` is one for many starts, and `jax.vmap` of it solves them at once.

    Args:
      problem: what to optimise.
      method: how: `ILQR`, `Shooting`, `PredictiveSampling`, `MPPI`, `CEM`.
      ctrls: first guess; small random controls by default.
      key: of the default guess, and of methods that draw samples.
      progress: write a line with the cost after each iteration to standard error.

    Returns:
      The plan. Trouble is in its `status`, never an exception.

    Raises:
      ProblemError: the guess has the wrong shape, or the method has no iterations.
    """
    if method.iterations < 1:
        raise ProblemError(f"iterations must be at least 1, got {method.iterations}")
    run = _watched if progress else _compiled
    return run(problem, method, *guess(problem, ctrls, key))


def guess(
    problem: Problem, ctrls: Any, key: jax.Array | None
) -> tuple[Float[Array, "T nu"], jax.Array]:
    """Controls of the right shape and type, within the limits, and a key for the method."""
    first, rest = jax.random.split(jax.random.key(0) if key is None else key)
    if ctrls is None:
        return problem.random_ctrls(first), rest
    shape = (problem.horizon, *problem.low.shape)
    if jnp.shape(ctrls) != shape:
        raise ProblemError(f"ctrls must have shape {shape}, got {jnp.shape(ctrls)}")
    return problem.clip(jnp.asarray(ctrls, problem.low.dtype)), rest


def _compiled(problem: Problem, method: Method, ctrls: Array, key: jax.Array) -> Plan:
    """All iterations as one program."""

    def unfinished(carry):
        count, now, _ = carry
        return (count < method.iterations) & (now.status == PlanStatus.RUNNING)

    def body(carry):
        count, now, history = carry
        now = method.improve(problem, now)
        return count + 1, now, history.at[count].set(now.cost)

    def run(ctrls, key):
        history = jnp.full(method.iterations, jnp.nan, ctrls.dtype)
        carry = (0, method.start(problem, ctrls, key), history)
        return _plan(*lax.while_loop(unfinished, body, carry))

    return jax.jit(run)(ctrls, key)


def _watched(problem: Problem, method: Method, ctrls: Array, key: jax.Array) -> Plan:
    """The same iteration by iteration, with a line for each."""
    improve = jax.jit(lambda now: method.improve(problem, now))
    now = method.start(problem, ctrls, key)
    history, start = np.full(method.iterations, np.nan, ctrls.dtype), time.perf_counter()
    count = 0
    while count < method.iterations and int(now.status) == PlanStatus.RUNNING:
        now = improve(now)
        history[count] = now.cost
        count += 1
        seconds = time.perf_counter() - start
        line = f"iteration {count:4d}  cost {float(now.cost):12.6g}  {seconds:6.1f} s"
        sys.stderr.write(f"\r{line}")
    sys.stderr.write("\n")
    return _plan(count, now, jnp.asarray(history))


def _plan(count: Any, now: Iterate, history: Float[Array, "N"]) -> Plan:
    out = now.status == PlanStatus.RUNNING
    return Plan(
        ctrls=now.ctrls,
        states=now.states,
        cost=now.cost,
        status=jnp.where(out, PlanStatus.ITERATIONS, now.status),
        iterations=jnp.asarray(count),
        history=history,
        gains=now.gains,
        defect=now.defect,
    )
