"""Limits on states, for any method: an augmented Lagrangian.

The numbers g that a problem's `state_limits` returns are to be at most zero. A method minimises

    L = cost + sum over t of (|max(0, mu_t + rho g(x_t))|^2 - |mu_t|^2) / (2 rho)

and where it has come to rest, `max(0, mu_t + rho g(x_t))` are the next multipliers mu, and the
penalty rho grows unless the violation has become much smaller (Hestenes 1969, Powell 1969).
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.trajopt.plan import Iterate, PlanStatus, shifted
from jaxsim.trajopt.problem import Problem, ProblemError

# Multipliers change when the method is at rest, or after so many iterations.
_PATIENCE = 25
# The penalty grows by the first factor unless the violation shrinks by the second.
_GROWTH, _PROGRESS = 10.0, 0.25
_LARGEST_PENALTY = 1e6


@struct.dataclass
class _Memory:
    """Between iterations: the method's own iterate, and what it minimises.

    Attributes:
      inner: of the method.
      key: of the method, for when it begins anew.
      multipliers: mu of each state.
      penalty: rho.
      violation: when multipliers changed last.
      age: iterations since then.
    """

    inner: Iterate
    key: jax.Array
    multipliers: Float[Array, "T+1 m"]
    penalty: Float[Array, ""]
    violation: Float[Array, ""]
    age: Int[Array, ""]


@dataclasses.dataclass(frozen=True)
class AugmentedLagrangian:
    """A method under the problem's `state_limits`; `plan.defect` is how far they are exceeded.

    Costs are L, which is the problem's where limits hold.

    Attributes:
      method: minimises L.
      iterations: of the method, all together, at most.
      penalty: rho at first.
      tolerance: the largest violation that is taken for none.
    """

    method: Any
    iterations: int = 300
    penalty: float = 10.0
    tolerance: float = 1e-3

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """Without multipliers."""
        kind = ctrls.dtype
        size = jax.eval_shape(_limits_of(problem), problem.start).shape[0]
        inner = self.method.start(problem, ctrls, key)
        return inner.replace(
            memory=_Memory(
                inner=inner,
                key=key,
                multipliers=jnp.zeros((problem.horizon + 1, size), kind),
                penalty=jnp.asarray(self.penalty, kind),
                violation=jnp.asarray(jnp.inf, kind),
                age=jnp.zeros((), int),
            )
        )

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """One iteration of the method, and other multipliers if it is at rest."""
        memory = now.memory
        inner = self.method.improve(_lagrangian(problem, memory), memory.inner)
        g = jax.vmap(_limits_of(problem))(inner.states).at[0].set(-jnp.inf)
        violation = jnp.max(g, initial=0)
        rests = inner.status != PlanStatus.RUNNING
        over = rests & ((violation <= self.tolerance) | (inner.status == PlanStatus.DIVERGED))
        following = memory.replace(inner=inner, age=memory.age + 1)
        again = self._next_round(problem, following, g, violation)
        ended = (rests | (memory.age >= _PATIENCE)) & ~over
        memory = jax.tree.map(lambda a, b: jnp.where(ended, a, b), again, following)
        status = jnp.where(over, inner.status, PlanStatus.RUNNING)
        return inner.replace(
            status=status, memory=memory, defect=jnp.maximum(violation, inner.defect)
        )

    def shift(self, now: Iterate) -> Iterate:
        """The method's iterate and the multipliers one step later."""
        memory = now.memory
        inner = self.method.shift(memory.inner)
        memory = memory.replace(inner=inner, multipliers=shifted(memory.multipliers))
        return inner.replace(memory=memory)

    def _next_round(self, problem, memory: _Memory, g, violation) -> _Memory:
        rho = memory.penalty
        slow = violation > _PROGRESS * memory.violation
        memory = memory.replace(
            multipliers=jnp.maximum(memory.multipliers + rho * g, 0),
            penalty=jnp.where(slow, jnp.minimum(rho * _GROWTH, _LARGEST_PENALTY), rho),
            violation=violation,
            age=jnp.zeros_like(memory.age),
        )
        begun = self.method.start(_lagrangian(problem, memory), memory.inner.ctrls, memory.key)
        # What a guess has not is what was known before.
        return memory.replace(inner=begun.replace(states=memory.inner.states))


def _limits_of(problem: Problem) -> Callable[[Any], Float[Array, "m"]]:
    if problem.state_limits is None:
        raise ProblemError("AugmentedLagrangian needs a problem with state_limits")
    return problem.state_limits


def _lagrangian(problem: Problem, memory: _Memory) -> Problem:
    """The problem whose cost is L."""
    limits = _limits_of(problem)

    def penalty(x, t):
        mu, rho = memory.multipliers[t], memory.penalty
        push = jnp.maximum(mu + rho * limits(x), 0)
        return (push @ push - mu @ mu) / (2 * rho)

    def running_cost(x, u, t):
        # No control can change the first state.
        return problem.running_cost(x, u, t) + jnp.where(t > 0, penalty(x, t), 0)

    def final_cost(x):
        return problem.final_cost(x) + penalty(x, problem.horizon)

    return problem.replace(running_cost=running_cost, final_cost=final_cost, state_limits=None)
