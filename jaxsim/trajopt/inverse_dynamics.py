"""Optimisation over positions, with inverse dynamics in place of simulation.

    minimise  sum_t running_cost(x_t, u_t, t) + final_cost(x_T)
    over      q_1 ... q_T, u_0 ... u_{T-1}        such that    c_t = 0,  low <= u_t <= high

Velocities are differences of positions, and c_t is the force that is missing for the engine's own
step to follow them (`jaxsim.trajopt.transcription.three_point`). Contacts are part of it, so the
optimiser moves them in time and place, and replaying the plan gives the plan (Kurtz and others
2023, "Inverse dynamics trajectory optimization for contact-implicit model predictive control").

The constraints are those of an augmented Lagrangian, whose minima are found by Gauss-Newton steps.
An iteration tries several dampings at once and takes the best. Controls make up for what forces
miss beyond first order, so that only what no motor can do limits the steps.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.constraint.laws import RIGID, Blur
from jaxsim.model import Model
from jaxsim.trajopt.plan import Iterate, PlanStatus, first_iterate, shifted
from jaxsim.trajopt.problem import Problem, ProblemError
from jaxsim.trajopt.space import StateSpace
from jaxsim.trajopt.transcription.damped import MOST_DAMPING, damped_step
from jaxsim.trajopt.transcription.lagrangian import Multipliers, excess
from jaxsim.trajopt.transcription.three_point import Path, ThreePoint, begin_at, replayed, states_of

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
# Friction of blurred contacts: at this speed (m/s), times the blur, it is near its bound.
_SPEED = 0.1
# Blur shrinks by this factor, until so little is left that it does not matter.
_SHARPEN, _SHARP = 0.5, 0.05
# A minimum with blur need not be exact: relative decrease of L at which it is good enough, and the
# largest missing force (N or N m).
_GOOD_ENOUGH, _FEASIBLE = 1e-3, 1e-2
# A replay that costs at most so much more, in units of the tolerance, is taken for the plan.
_CLOSE = 10
# Blur and penalty that a plan begins with when it is made anew: contacts that slipped or ended too
# soon are felt, also from where a finger goes back to after a push.
_BLUR_AGAIN, _PENALTY_AGAIN = 0.6, 1e3
# Largest penalties with and without blur, and the first one without.
_PENALTIES = 1e4, 1e6
_SHARP_PENALTY = 1e2


@struct.dataclass
class _Memory:
    """Between iterations.

    Attributes:
      path: positions and controls.
      multipliers: of the augmented Lagrangian.
      damping: of the last step.
      blur: from 1, at first, to 0.
      defect: the constraint violation when multipliers changed last.
    """

    path: Path
    multipliers: Multipliers
    damping: Float[Array, ""]
    blur: Float[Array, ""]
    defect: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class InverseDynamics:
    """Gauss-Newton over positions; finds contacts by itself.

    Attributes:
      iterations: at most so many.
      path: first guess of q_1, ... q_T, (T, nq); by default all are the start.
      reach: scale of the distance at which contacts are felt at first (m), see
        `jaxsim.constraint.laws.blur`; 0 if the guess has the right contacts.
      penalty: of the augmented Lagrangian, at first.
      tolerance: converged when a step lowers L by less than this part of 1 + |cost|, and
      force_tolerance: no larger force is missing (N or N m).
    """

    iterations: int = 200
    path: Any = None
    reach: float = 0.0
    penalty: float = 100.0
    tolerance: float = 1e-4
    force_tolerance: float = 1e-7

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """The guess, with infinite cost."""
        model, kind, T = _model_of(problem), ctrls.dtype, problem.horizon
        start = problem.start.qpos[None]
        given = start if self.path is None else jnp.asarray(self.path, kind)
        if given.shape not in ((1, model.nq), (T, model.nq)):
            raise ProblemError(f"path must have shape {(T, model.nq)}, got {given.shape}")
        qpos = jnp.concatenate([start, start, jnp.broadcast_to(given, (T, model.nq))])
        none = jnp.zeros((T, model.nu), kind)
        number = lambda x: jnp.asarray(x, kind)  # noqa: E731
        return first_iterate(
            problem,
            ctrls,
            _Memory(
                path=begin_at(model, Path(qpos, ctrls), problem.start),
                multipliers=Multipliers(
                    jnp.zeros((T, model.nv), kind), none, none, number(self.penalty)
                ),
                damping=number(1.0),
                blur=number(1.0 if self.reach else 0.0),
                defect=number(jnp.inf),
            ),
        )

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """One iteration."""
        model, memory = _model_of(problem), now.memory
        old = begin_at(model, memory.path, problem.start)
        blur = Blur(self.reach * memory.blur, _SPEED * memory.blur) if self.reach else None
        way = ThreePoint(model, problem, blur)
        path, c, damping, fall = damped_step(way, memory.multipliers, old, memory.damping)
        return self._judged(problem, now, memory.replace(path=path, damping=damping), c, fall)

    def shift(self, now: Iterate) -> Iterate:
        """One step later, for a state that was measured anew; contacts are blurred again."""
        path, multipliers = shifted(now.memory.path), now.memory.multipliers.shifted()
        number = lambda x: jnp.asarray(x, now.ctrls.dtype)  # noqa: E731
        memory = now.memory.replace(
            path=path,
            multipliers=multipliers.replace(penalty=number(_PENALTY_AGAIN)),
            damping=jnp.minimum(now.memory.damping, 1),
            blur=number(_BLUR_AGAIN if self.reach else 0.0),
            defect=number(jnp.inf),
        )
        return now.replace(ctrls=shifted(now.ctrls), states=shifted(now.states), memory=memory)

    def _judged(self, problem: Problem, now: Iterate, memory: _Memory, c, fall) -> Iterate:
        """The iterate after a step; where it was small, or none helps, with new multipliers."""
        cost, defect = _quality(problem, memory.path, c)
        fall, sharp = fall / (1 + jnp.abs(cost)), memory.blur == 0
        minimal = memory.damping >= MOST_DAMPING
        minimal = minimal | (fall <= jnp.where(sharp, self.tolerance, _GOOD_ENOUGH))
        following = _with_next_multipliers(problem, memory, c, defect)
        memory = jax.tree.map(lambda a, b: jnp.where(minimal, a, b), following, memory)
        path, taken = self._engines(problem, memory, minimal & (memory.blur == 0), sharp, cost)
        memory = memory.replace(path=path)
        cost, defect = _quality(problem, path, jnp.where(taken, 0, c))
        done = sharp & minimal & (defect <= self.force_tolerance)
        status = jnp.where(done, PlanStatus.CONVERGED, PlanStatus.RUNNING)
        return now.replace(
            ctrls=problem.clip(path.ctrls),
            states=states_of(_model_of(problem), path, problem.start),
            cost=cost,
            status=jnp.where(jnp.isfinite(cost), status, PlanStatus.DIVERGED),
            defect=defect,
            memory=memory,
        )

    def _engines(self, problem: Problem, memory: _Memory, wanted, sharp, cost):
        """The path that the engine takes, if wanted and about as good; and whether it is that.

        The law itself begins and ends on such a path, however much worse it is at the beginning.
        """
        path = lax.cond(
            wanted,
            lambda path: replayed(_model_of(problem), problem, path),
            lambda path: path,
            memory.path,
        )
        most = cost + _CLOSE * self.tolerance * (1 + jnp.abs(cost))
        as_good = _quality(problem, path, jnp.zeros_like(memory.multipliers.missing))[0] <= most
        taken = wanted & (as_good | ~sharp)
        return jax.tree.map(lambda a, b: jnp.where(taken, a, b), path, memory.path), taken


def _quality(problem: Problem, path: Path, c: Float[Array, "T nv"]):
    """Cost and largest constraint violation of a path."""
    states = states_of(_model_of(problem), path, problem.start)
    violation = jnp.maximum(jnp.max(jnp.abs(c)), excess(problem, path.ctrls))
    return problem.total_cost(states, path.ctrls), violation


def _with_next_multipliers(problem: Problem, memory: _Memory, c, defect) -> _Memory:
    """For the next minimisation: other multipliers, less blur, a larger penalty if need be."""
    rho = memory.multipliers.penalty
    blur = jnp.where(defect <= _FEASIBLE, _SHARPEN * memory.blur, memory.blur)
    blur = jnp.where(blur < _SHARP, 0, blur)
    least, most = _PENALTIES
    slow = (defect > memory.defect / 4) & (blur == memory.blur)
    grown = jnp.minimum(10 * rho, jnp.where(blur > 0, least, most))
    penalty = jnp.where(slow, jnp.maximum(rho, grown), rho)
    # The law itself is another problem than what was blurred before.
    penalty = jnp.where((blur == 0) & (memory.blur > 0), _SHARP_PENALTY, penalty)
    # Multipliers follow only where they help; otherwise they could grow for ever.
    helps = defect < memory.defect
    following = jax.tree.map(
        lambda new, old: jnp.where(helps, new, old),
        memory.multipliers.updated(problem, memory.path.ctrls, c),
        memory.multipliers,
    )
    return memory.replace(
        multipliers=following.replace(penalty=penalty),
        damping=jnp.minimum(memory.damping, 1),
        blur=blur,
        defect=jnp.where(blur == memory.blur, jnp.minimum(defect, memory.defect), jnp.inf),
    )


def _model_of(problem: Problem) -> Model:
    """The model of a problem whose steps are those of semi-implicit Euler."""
    if not isinstance(problem.space, StateSpace):
        raise ProblemError("InverseDynamics needs dynamics that are a jaxsim.Model")
    model = problem.space.model
    for fault, found in (
        ("frame_skip=1", problem.frame_skip != 1),
        ("integrator 'Euler'", model.opt.integrator != _EULER),
        ("actuators without activation", model.na > 0),
        ("a law of contact with forces that need no solve, not 'hard'", model.contact in RIGID),
    ):
        if found:
            raise ProblemError(f"InverseDynamics needs {fault}")
    return model
