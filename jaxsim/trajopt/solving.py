"""`solve`: a problem, a method, a plan."""

import sys
import time
from collections.abc import Callable
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxsim.trajopt.direct import Direct
from jaxsim.trajopt.plan import Iterate, Plan, PlanStatus
from jaxsim.trajopt.problem import Problem, ProblemError
from jaxsim.trajopt.state_limits import AugmentedLagrangian


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
    starts: int = 1,
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
      starts: number of random guesses that are followed at once; the cheapest plan is returned.
      progress: write a line with the least cost after each iteration to standard error.

    Returns:
      The plan. Trouble is in its `status`, never an exception.

    Raises:
      ProblemError: a guess has the wrong shape, the method has no iterations or does not know
        limits on states, or there is a guess and several starts.
    """
    check_method(problem, method)
    if method.iterations < 1:
        raise ProblemError(f"iterations must be at least 1, got {method.iterations}")
    run = _watched if progress else _compiled
    return run(problem, method, *_guesses(problem, ctrls, key, starts))


def check_method(problem: Problem, method: Method) -> None:
    """An error if the method does not know what the problem has."""
    if problem.state_limits is not None and not isinstance(method, AugmentedLagrangian):
        raise ProblemError("the problem has state_limits; use AugmentedLagrangian(method)")
    if problem.complementarity is not None and not isinstance(method, Direct):
        raise ProblemError("the problem has complementarity; use Direct()")


def _guesses(problem: Problem, ctrls: Any, key: jax.Array | None, starts: int):
    """Controls (S, T, nu) and keys (S,)."""
    if starts < 1:
        raise ProblemError(f"starts must be at least 1, got {starts}")
    if starts == 1:
        return jax.tree.map(lambda x: x[None], guess(problem, ctrls, key))
    if ctrls is not None:
        raise ProblemError("several starts are random guesses; give either ctrls or starts")
    keys = jax.random.split(jax.random.key(0) if key is None else key, starts)
    return jax.vmap(lambda key: guess(problem, None, key))(keys)


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


def _compiled(problem: Problem, method: Method, ctrls: Array, keys: jax.Array) -> Plan:
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

    return jax.jit(lambda *guesses: _cheapest(_each(run)(*guesses)))(ctrls, keys)


def _watched(problem: Problem, method: Method, ctrls: Array, keys: jax.Array) -> Plan:
    """The same iteration by iteration, with a line for each."""

    def improved(now):
        running = now.status == PlanStatus.RUNNING
        after = method.improve(problem, now)
        cost = jnp.where(running, after.cost, jnp.nan)
        return jax.tree.map(lambda a, b: jnp.where(running, a, b), after, now), cost, running

    improve, begun = jax.jit(_each(improved)), time.perf_counter()
    now = _each(lambda *guess: method.start(problem, *guess))(ctrls, keys)
    history = np.full((len(ctrls), method.iterations), np.nan, ctrls.dtype)
    made = np.zeros(len(ctrls), int)
    for i in range(method.iterations):
        now, history[:, i], running = improve(now)
        made += running
        seconds = time.perf_counter() - begun
        line = f"iteration {i + 1:4d}  cost {float(now.cost.min()):12.6g}  {seconds:6.1f} s"
        sys.stderr.write(f"\r{line}")
        if not (now.status == PlanStatus.RUNNING).any():
            break
    sys.stderr.write("\n")
    return _cheapest(jax.vmap(_plan)(jnp.asarray(made), now, jnp.asarray(history)))


def _each(f: Callable) -> Callable:
    """`f` for each start; for a single one it is not mapped."""

    def mapped(*args):
        if len(jax.tree.leaves(args)[0]) > 1:
            return jax.vmap(f)(*args)
        return jax.tree.map(lambda x: x[None], f(*jax.tree.map(lambda x: x[0], args)))

    return mapped


def _cheapest(plans: Plan) -> Plan:
    """The one of least cost among plans of several starts; those that keep constraints first."""
    cost = jnp.where(jnp.isnan(plans.cost), jnp.inf, plans.cost)
    kept = (plans.status == PlanStatus.CONVERGED) | (plans.defect == 0)
    best = jnp.lexsort((cost, ~(kept & jnp.isfinite(cost))))[0]
    return jax.tree.map(lambda x: x[best], plans)


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
