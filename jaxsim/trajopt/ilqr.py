"""iLQR with bounds on controls (Tassa et al. 2014): the problem to second order, again and again.

Each iteration tries the policy of the last one at several step lengths at once, keeps the best
trajectory, expands the problem there and solves the expansion backwards. Damping shrinks after a
success and grows after a failure, as in Levenberg and Marquardt's method.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.batching import vmap
from jaxsim.trajopt.expansion import expand
from jaxsim.trajopt.plan import Iterate, PlanStatus, first_iterate, keep_best, shifted
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.riccati import backward

# Step lengths 1, 0.91, 0.68, ... 4e-4, denser near 1.
_LENGTHS = 1.1 ** -(np.arange(10.0) ** 2)
_LEAST_DAMPING, _MOST_DAMPING = 1e-8, 1e8


class _Memory(NamedTuple):
    """The policy to try next, what it promises, and the damping it was found with."""

    offset: Float[Array, "T nu"]
    promise: Float[Array, ""]
    damping: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class ILQR:
    """Iterative linear-quadratic regulator.

    Attributes:
      iterations: at most so many.
      tolerance: converged when the expansion promises less than this part of 1 + |cost|.
      damping: of the first iteration; see `jaxsim.trajopt.riccati`.
    """

    iterations: int = 100
    tolerance: float = 1e-6
    damping: float = 1e-3

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """No policy yet: the first iteration evaluates the guess."""
        infinite = jnp.asarray(jnp.inf, ctrls.dtype)
        damping = jnp.asarray(self.damping, ctrls.dtype)
        memory = _Memory(jnp.zeros_like(ctrls), infinite, damping)
        gains = jnp.zeros((*ctrls.shape, problem.space.size), ctrls.dtype)
        return first_iterate(problem, ctrls, memory).replace(gains=gains)

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """One iteration."""
        states, ctrls, cost = _best_rollout(problem, now)
        damping = _next_damping(now.memory.damping, cost < now.cost)
        now = keep_best(now, ctrls, states, cost)
        low, high = problem.low[None] - now.ctrls, problem.high[None] - now.ctrls
        policy = backward(expand(problem, now.states, now.ctrls), low, high, damping)
        return now.replace(
            gains=policy.gains,
            status=self._status(now.cost, policy.promise, damping),
            memory=_Memory(policy.offset, policy.promise, damping),
        )

    def shift(self, now: Iterate) -> Iterate:
        """One step later, for a state that was measured anew."""
        memory = now.memory._replace(offset=shifted(now.memory.offset))
        return now.replace(
            ctrls=shifted(now.ctrls),
            states=shifted(now.states),
            gains=shifted(now.gains),
            cost=jnp.full_like(now.cost, jnp.inf),
            memory=memory,
        )

    def _status(self, cost, promise, damping):
        small = promise <= self.tolerance * (1 + jnp.abs(cost))
        status = jnp.where(small, PlanStatus.CONVERGED, PlanStatus.RUNNING)
        status = jnp.where(damping > _MOST_DAMPING, PlanStatus.STALLED, status)
        return jnp.where(jnp.isfinite(cost), status, PlanStatus.DIVERGED)


def _best_rollout(problem: Problem, now: Iterate) -> tuple[Any, Any, Any]:
    """States, controls and cost of the policy at the best of several step lengths."""
    before = jax.tree.map(lambda x: x[:-1], now.states)

    def attempt(length):
        def policy(x, given):
            old, u, k, gains = given
            return problem.clip(u + length * k + gains @ problem.space.difference(old, x))

        inputs = (before, now.ctrls, now.memory.offset, now.gains)
        return problem.follow(policy, inputs)

    states, ctrls, costs = vmap(attempt)(_LENGTHS.astype(now.ctrls.dtype))
    best = jnp.argmin(jnp.where(jnp.isnan(costs), jnp.inf, costs))
    states, ctrls = jax.tree.map(lambda x: x[best], (states, ctrls))
    return states, ctrls, costs[best]


def _next_damping(damping, better):
    """Less after a success, down to none at all; more after a failure."""
    less = jnp.where(damping > _LEAST_DAMPING, damping / 4, 0)
    more = jnp.maximum(damping, _LEAST_DAMPING) * 10
    return jnp.where(better, less, more)
