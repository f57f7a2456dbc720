"""iLQR with bounds on controls (Tassa et al. 2014): the problem to second order, again and again.

Each iteration tries the policy of the last one at several step lengths at once, keeps the best
trajectory, expands the problem there and solves the expansion backwards. Damping shrinks after a
success and grows after a failure, as in Levenberg and Marquardt's method.

States may begin as a guess (`jaxsim.trajopt.state_guess`). Then a rollout keeps, after each step,
what its step length leaves of the gap there.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.batching import vmap
from jaxsim.trajopt.expansion import Expansion, expand
from jaxsim.trajopt.plan import Iterate, PlanStatus, first_iterate, keep_where, shifted
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.riccati import Policy, backward
from jaxsim.trajopt.state_guess import states_from, worth_of_gaps

# Step lengths 1, 0.91, 0.68, ... 4e-4, denser near 1.
_LENGTHS = 1.1 ** -(np.arange(10.0) ** 2)
_LEAST_DAMPING, _MOST_DAMPING = 1e-8, 1e8


class _Memory(NamedTuple):
    """The policy to try next, and what is known of it.

    Attributes:
      offset: of the policy; its gains are the iterate's.
      promise: how much it lowers the cost.
      damping: what it was found with.
      gaps: between the states, where these began as a guess, or None.
      worth: of closing them, in units of cost.
    """

    offset: Float[Array, "T nu"]
    promise: Float[Array, ""]
    damping: Float[Array, ""]
    gaps: Float[Array, "T n"] | None
    worth: Float[Array, ""]


class _Trial(NamedTuple):
    """A trajectory, and which share of the gaps it leaves open."""

    ctrls: Float[Array, "T nu"]
    states: Any
    cost: Float[Array, ""]
    open: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class ILQR:
    """Iterative linear-quadratic regulator.

    Attributes:
      iterations: at most so many.
      tolerance: converged when the expansion promises less than this part of 1 + |cost|, and states
        have no gaps.
      damping: of the first iteration; see `jaxsim.trajopt.riccati`.
      states: first guess of the states (T+1, ...), which need not follow from the controls
        (multiple shooting); by default they do. The first one is the problem's start.
    """

    iterations: int = 100
    tolerance: float = 1e-6
    damping: float = 1e-3
    states: Any = None

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """No policy yet: the first iteration evaluates the guess."""
        number = lambda x: jnp.asarray(x, ctrls.dtype)  # noqa: E731
        offset, damping = jnp.zeros_like(ctrls), number(self.damping)
        memory = _Memory(offset, number(jnp.inf), damping, gaps=None, worth=number(0))
        gains = jnp.zeros((*ctrls.shape, problem.space.size), ctrls.dtype)
        guess = first_iterate(problem, ctrls, memory).replace(gains=gains)
        if self.states is None:
            return guess
        return guess.replace(
            states=states_from(problem, self.states),
            defect=number(jnp.inf),
            memory=memory._replace(gaps=jnp.zeros_like(gains[:, 0])),
        )

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """One iteration."""
        trial, worth = _best_rollout(problem, now), now.memory.worth
        if self.states is not None:
            trial = _guess_first(problem, now, trial)
        better = trial.cost + trial.open * worth < now.cost + worth
        damping = _next_damping(now.memory.damping, better)
        now = keep_where(better, now, trial.ctrls, trial.states, trial.cost)
        near = self._expansion(problem, now)
        if self.states is not None:
            closed = (better & (trial.open == 0)) | (now.defect == 0)
            near = near.replace(defect=jnp.where(closed, 0, near.defect))
        low, high = problem.low[None] - now.ctrls, problem.high[None] - now.ctrls
        policy = self._policy(problem, now, near, low, high, damping)
        memory = now.memory._replace(offset=policy.offset, promise=policy.promise, damping=damping)
        now = now.replace(gains=policy.gains, memory=memory)
        if self.states is not None:
            now = self._with_gaps(now, near, policy)
        return now.replace(status=self._status(now))

    def shift(self, now: Iterate) -> Iterate:
        """One step later, for a state that was measured anew."""
        memory = now.memory._replace(
            offset=shifted(now.memory.offset), gaps=shifted(now.memory.gaps)
        )
        return now.replace(
            ctrls=shifted(now.ctrls),
            states=shifted(now.states),
            gains=shifted(now.gains),
            cost=jnp.full_like(now.cost, jnp.inf),
            memory=memory,
        )

    def _expansion(self, problem: Problem, now: Iterate) -> Expansion:
        return expand(problem, now.states, now.ctrls)

    def _policy(
        self, problem: Problem, now: Iterate, near: Expansion, low, high, damping
    ) -> Policy:
        return backward(near, low, high, damping)

    def _with_gaps(self, now: Iterate, near: Expansion, policy: Policy) -> Iterate:
        worth = worth_of_gaps(near, policy, now.cost, self.tolerance)
        memory = now.memory._replace(gaps=near.defect, worth=worth)
        return now.replace(defect=jnp.abs(near.defect).max(), memory=memory)

    def _status(self, now: Iterate):
        small = now.memory.promise <= self.tolerance * (1 + jnp.abs(now.cost))
        done = small & (now.defect == 0)
        status = jnp.where(done, PlanStatus.CONVERGED, PlanStatus.RUNNING)
        status = jnp.where(now.memory.damping > _MOST_DAMPING, PlanStatus.STALLED, status)
        return jnp.where(jnp.isfinite(now.cost + now.defect), status, PlanStatus.DIVERGED)


def _best_rollout(problem: Problem, now: Iterate) -> _Trial:
    """The policy at the best of several step lengths."""
    before, memory = jax.tree.map(lambda x: x[:-1], now.states), now.memory
    lengths = _LENGTHS.astype(now.ctrls.dtype)

    def attempt(length):
        def policy(x, given):
            old, u, k, gains = given
            return problem.clip(u + length * k + gains @ problem.space.difference(old, x))

        inputs = (before, now.ctrls, memory.offset, now.gains)
        jumps = None if memory.gaps is None else (length - 1) * memory.gaps
        states, ctrls, cost = problem.follow(policy, inputs, jumps)
        return _Trial(ctrls, states, cost, 1 - length)

    trials = vmap(attempt)(lengths)
    merits = trials.cost + trials.open * memory.worth
    best = jnp.argmin(jnp.where(jnp.isnan(merits), jnp.inf, merits))
    return jax.tree.map(lambda x: x[best], trials)


def _guess_first(problem: Problem, now: Iterate, trial: _Trial) -> _Trial:
    """What is evaluated: a guess of states as it is, as long as nobody knows its gaps."""
    cost = problem.total_cost(now.states, now.ctrls)
    guess = _Trial(now.ctrls, now.states, cost, jnp.ones_like(trial.open))
    return jax.tree.map(lambda a, b: jnp.where(jnp.isinf(now.defect), a, b), guess, trial)


def _next_damping(damping, better):
    """Less after a success, down to none at all; more after a failure."""
    less = jnp.where(damping > _LEAST_DAMPING, damping / 4, 0)
    more = jnp.maximum(damping, _LEAST_DAMPING) * 10
    return jnp.where(better, less, more)
