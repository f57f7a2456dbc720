"""The direct method: states, controls and contact forces are unknowns, contact an equation.

    minimise  sum_t running_cost(x_t, u_t, t) + final_cost(x_T)
    over      x_1 ... x_T, u_0 ... u_{T-1}
    such that x_{t+1} = step(x_t, u_t),  low <= u_t <= high,  0 <= a_t, 0 <= b_t, a_t b_t = 0

The last of these are the problem's `complementarity`: what does not touch has no force. They are
smooth equations, `a b = s`, with s from 0.1 to 1e-8 by tens (Posa, Cantu, Tedrake 2014), so that
forces act at a distance first (`jaxsim.trajopt.transcription.complementarity`). The equations are
those of an augmented Lagrangian, whose minima are found by damped Gauss-Newton steps.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.trajopt.plan import Iterate, PlanStatus, first_iterate, shifted
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.state_guess import states_from
from jaxsim.trajopt.transcription.complementarity import StatePath, StatesAndControls, begin_at
from jaxsim.trajopt.transcription.damped import MOST_DAMPING, DampedStep, damped_step
from jaxsim.trajopt.transcription.lagrangian import Multipliers, excess, in_blocks

_MOST_SMOOTHING, _LEAST_SMOOTHING = 1e-1, 1e-8
# A smooth minimum need not be exact: relative decrease of L at which it is good enough, and the
# violation, times the root of s, above which s stays.
_GOOD_ENOUGH, _FEASIBLE = 1e-3, 3e-2
_MOST_PENALTY = 1e6
# Steps onto the constraints at the end.
_RESTORING = 4


@struct.dataclass
class _Memory:
    """Between iterations.

    Attributes:
      path: states and controls.
      multipliers: of the augmented Lagrangian.
      damping: of the last step.
      smoothing: s.
      defect: the constraint violation when multipliers changed last.
    """

    path: StatePath
    multipliers: Multipliers
    damping: Float[Array, ""]
    smoothing: Float[Array, ""]
    defect: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class Direct:
    """Direct transcription with complementarity; finds contacts by itself.

    Attributes:
      iterations: at most so many.
      states: first guess of the states (T+1, ...); by default all are the start.
      penalty: of the augmented Lagrangian, at first.
      tolerance: converged when a step lowers L by less than this part of 1 + |cost|, and
      feasibility: no constraint is violated by more, nor is a product of a pair larger.
    """

    iterations: int = 300
    states: Any = None
    penalty: float = 100.0
    tolerance: float = 1e-4
    feasibility: float = 1e-6

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """The guess, with infinite cost."""
        T, kind = problem.horizon, ctrls.dtype
        number = lambda x: jnp.asarray(x, kind)  # noqa: E731
        guess = first_iterate(problem, ctrls, None)
        states = guess.states if self.states is None else states_from(problem, self.states)
        path, none = StatePath(states, ctrls), jnp.zeros_like(ctrls)
        way = StatesAndControls(problem, number(_MOST_SMOOTHING))
        size = jax.eval_shape(way.gaps, path).shape[1]
        return guess.replace(
            states=states,
            memory=_Memory(
                path=path,
                multipliers=Multipliers(
                    jnp.zeros((T, size), kind), none, none, number(self.penalty)
                ),
                damping=number(1.0),
                smoothing=number(_MOST_SMOOTHING),
                defect=number(jnp.inf),
            ),
        )

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """One iteration."""
        memory = now.memory
        way = StatesAndControls(problem, memory.smoothing)
        path = begin_at(memory.path, problem.start)
        step = damped_step(way, memory.multipliers, path, memory.damping)
        memory = memory.replace(path=step.path, damping=step.damping)
        return self._judged(way, now, memory, step)

    def shift(self, now: Iterate) -> Iterate:
        """One step later, for a state that was measured anew."""
        path, multipliers = shifted(now.memory.path), now.memory.multipliers.shifted()
        memory = now.memory.replace(path=path, multipliers=multipliers)
        return now.replace(ctrls=shifted(now.ctrls), states=shifted(now.states), memory=memory)

    def _judged(
        self, way: StatesAndControls, now: Iterate, memory: _Memory, step: DampedStep
    ) -> Iterate:
        """The iterate after a step; where it was small, or none helps, with new multipliers."""
        problem, sharp = way.problem, memory.smoothing <= _LEAST_SMOOTHING
        fall = step.fall / (1 + jnp.abs(way.cost(memory.path)))
        minimal = memory.damping >= MOST_DAMPING
        minimal = minimal | (fall <= jnp.where(sharp, self.tolerance, _GOOD_ENOUGH))
        following = _with_next_multipliers(problem, memory, step.missing)
        ended = minimal & sharp
        path = lax.cond(ended, lambda path: _finished(way, path), lambda path: path, memory.path)
        defect = _violation(way, path)
        done = ended & (defect <= self.feasibility)
        memory = jax.tree.map(lambda a, b: jnp.where(minimal, a, b), following, memory)
        status = jnp.where(done, PlanStatus.CONVERGED, PlanStatus.RUNNING)
        cost = way.cost(path)
        return now.replace(
            ctrls=problem.clip(path.ctrls),
            states=path.states,
            cost=cost,
            status=jnp.where(jnp.isfinite(cost), status, PlanStatus.DIVERGED),
            defect=defect,
            memory=memory,
        )


def restored(way: StatesAndControls, path: StatePath) -> StatePath:
    """The nearest path, to first order, that violates no equation: a few Gauss-Newton steps."""

    def again(_, path):
        c, J = way.gap_slopes(path)
        gradient = jnp.einsum("tci,tc->ti", J, c)
        hessian = jnp.einsum("tci,tcj->tij", J, J)
        g, H = in_blocks(way.size, path.ctrls.shape[1], _ended(gradient), _ended(hessian))
        least = 1e-9 * jnp.eye(g.shape[1], dtype=g.dtype)[None]
        return way.moved(path, -H._replace(diagonal=H.diagonal + least).solve(g))

    return lax.fori_loop(0, _RESTORING, again, path)


def _finished(way: StatesAndControls, path: StatePath) -> StatePath:
    """A path without violations; the one that its controls lead to, if that violates no more."""
    path = restored(way, path)
    path = path.replace(ctrls=way.problem.clip(path.ctrls))
    replay = path.replace(states=way.problem.rollout(path.ctrls)[0])
    exact = _violation(way, replay) <= _violation(way, path)
    return jax.tree.map(lambda a, b: jnp.where(exact, a, b), replay, path)


def _ended(x: Float[Array, "T *k"]) -> Float[Array, "T+1 *k"]:
    """With zeros for the final cost."""
    return jnp.concatenate([x, jnp.zeros_like(x[:1])])


def _violation(way: StatesAndControls, path: StatePath) -> Float[Array, ""]:
    """The largest violation of any constraint, without smoothing."""
    steps = way.gaps(path)[:, : way.size]
    return jnp.maximum(
        jnp.maximum(jnp.max(jnp.abs(steps)), jnp.max(way.products(path), initial=0)),
        excess(way.problem, path.ctrls),
    )


def _with_next_multipliers(problem: Problem, memory: _Memory, c: Float[Array, "T r"]) -> _Memory:
    """For the next minimisation: other multipliers, less smoothing or a larger penalty."""
    rho, s = memory.multipliers.penalty, memory.smoothing
    defect = jnp.maximum(jnp.max(jnp.abs(c)), excess(problem, memory.path.ctrls))
    feasible = defect <= _FEASIBLE * jnp.sqrt(s)
    following = jnp.where(feasible, jnp.maximum(s / 10, _LEAST_SMOOTHING), s)
    same = following == s
    slow = same & (defect > memory.defect / 4)
    multipliers = memory.multipliers.updated(problem, memory.path.ctrls, c)
    return memory.replace(
        multipliers=multipliers.replace(
            penalty=jnp.where(slow, jnp.minimum(10 * rho, _MOST_PENALTY), rho)
        ),
        damping=jnp.minimum(memory.damping, 1),
        smoothing=following,
        defect=jnp.where(same, defect, jnp.inf),
    )
