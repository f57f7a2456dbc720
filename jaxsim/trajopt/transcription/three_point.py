"""A model's step as an equation between three positions, and costs as functions of two.

With `v_t = (q_t - q_{t-1}) / h`, the differences along the joints, a trajectory is a path of
positions q_{-1}, q_0, q_1, ... q_T, whose first two are given by the start. Semi-implicit Euler
leads from one to the next if

    c_t(q_{t-1}, q_t, q_{t+1}, u_t) = 0,    t = 0 ... T-1,

where c is the generalised force that is missing (`jaxsim.engine.discrete_inverse`).
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.batching import matrices
from jaxsim.constraint.laws import Blur
from jaxsim.engine.discrete_inverse import missing_force
from jaxsim.joints.coordinates import difference_pos, integrate_pos
from jaxsim.model import Model, State
from jaxsim.trajopt.expansion import second_order
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.transcription.lagrangian import Expansion


@struct.dataclass
class Path:
    """Positions and controls.

    Attributes:
      qpos: q_{-1}, q_0, ... q_T.
      ctrls: u_0, ... u_{T-1}.
    """

    qpos: Float[Array, "T+2 nq"]
    ctrls: Float[Array, "T nu"]


@dataclasses.dataclass(frozen=True)
class ThreePoint:
    """A problem of positions and controls; a `Transcription`.

    Attributes:
      model: the model.
      problem: the problem, whose dynamics are the model.
      blur: how much the law of contact is smoothed; None for the law itself.
    """

    model: Model
    problem: Problem
    blur: Blur | None = None

    @property
    def size(self) -> int:
        """Degrees of freedom."""
        return self.model.nv

    def cost(self, path: Path) -> Float[Array, ""]:
        """Cost of a path."""
        return self.problem.total_cost(states_of(self.model, path, self.problem.start), path.ctrls)

    def moved(self, path: Path, step: Float[Array, "T nv+nu"]) -> Path:
        """The path with q_1, ... q_T moved along the joints, and other controls."""
        nv = self.model.nv
        move = jax.vmap(lambda q, dq: integrate_pos(self.model, q, dq, 1.0))
        qpos = path.qpos.at[2:].set(move(path.qpos[2:], step[:, :nv]))
        return Path(qpos, path.ctrls + step[:, nv:])

    def after(self, at: Expansion, path: Path, step: Float[Array, "T nv+nu"]) -> Path:
        """As `moved`, with controls that make up for what forces miss beyond first order."""
        trial = self.moved(path, step)
        surprise = self.gaps(trial) - at.missing_after(step)
        by_ctrls = at.slopes[:, :, 3 * self.model.nv :]
        least = 1e-9 * jnp.eye(self.model.nu, dtype=step.dtype)
        correct = jax.vmap(lambda B, c: matrices.solve(B.T @ B + least, B.T @ c))
        return trial.replace(ctrls=trial.ctrls - correct(by_ctrls, surprise))

    def gaps(self, path: Path) -> Float[Array, "T nv"]:
        """c_t, the missing forces."""
        q, steps = path.qpos, jnp.arange(self.problem.horizon)
        return jax.vmap(self._gap)(steps, q[:-2], q[1:-1], q[2:], path.ctrls)

    def gap_slopes(self, path: Path):
        """c_t, and its derivative by moves of q_{t-1}, q_t and q_{t+1} and by u_t.

        Shapes are (T, nv) and (T, nv, 3 nv + nu).
        """
        model, nv, q = self.model, self.model.nv, path.qpos

        def gap(z, t, a, b, c, u):
            a, b, c = (
                integrate_pos(model, p, dq, 1.0)
                for p, dq in zip((a, b, c), z[: 3 * nv].reshape(3, nv), strict=True)
            )
            found = self._gap(t, a, b, c, u + z[3 * nv :])
            return found, found

        origin = jnp.zeros(3 * nv + model.nu, q.dtype)
        slopes, values = jax.vmap(lambda *at: jax.jacfwd(gap, has_aux=True)(origin, *at))(
            jnp.arange(self.problem.horizon), q[:-2], q[1:-1], q[2:], path.ctrls
        )
        return values, slopes

    def cost_expansion(self, path: Path):
        """Gradients and Hessians of the costs by moves of q_{t-1} and q_t and by u_t.

        Shapes are (T, 2 nv + nu) and (T, 2 nv + nu, 2 nv + nu); then those of the final cost, whose
        sizes are 2 nv. Where a cost is concave it counts as flat.
        """
        model, problem, nv, q = self.model, self.problem, self.model.nv, path.qpos

        def state(z, t, a, b):
            a, b = (integrate_pos(model, a, z[:nv], 1.0), integrate_pos(model, b, z[nv:], 1.0))
            return _state(model, problem.start, t, a, b)

        def running(z, t, a, b, u):
            return problem.running_cost(state(z[: 2 * nv], t, a, b), u + z[2 * nv :], t)

        def final(z, a, b):
            return problem.final_cost(state(z, problem.horizon, a, b))

        origin = np.zeros(2 * nv + model.nu, q.dtype)
        steps = jnp.arange(problem.horizon)
        each = jax.vmap(second_order(running, origin))(steps, q[:-2], q[1:-1], path.ctrls)
        return *each, *second_order(final, origin[: 2 * nv])(q[-2], q[-1])

    def _gap(self, t, a, b, c, u) -> Float[Array, "nv"]:
        after = difference_pos(self.model, b, c, self.model.opt.timestep)
        state = _state(self.model, self.problem.start, t, a, b)
        return missing_force(self.model, state, u, after, self.blur)


def begin_at(model: Model, path: Path, start: State) -> Path:
    """The path with its first two positions replaced by those of a state."""
    before = integrate_pos(model, start.qpos, start.qvel, -model.opt.timestep)
    return path.replace(qpos=path.qpos.at[0].set(before).at[1].set(start.qpos))


def states_of(model: Model, path: Path, start: State) -> State:
    """The states (T+1, ...) of a path."""
    steps = jnp.arange(len(path.ctrls) + 1)
    return jax.vmap(lambda t, a, b: _state(model, start, t, a, b))(
        steps, path.qpos[:-1], path.qpos[1:]
    )


def replayed(model: Model, problem: Problem, path: Path) -> Path:
    """The path on which the engine takes these controls."""
    ctrls = problem.clip(path.ctrls)
    states, _ = problem.rollout(ctrls)
    return Path(jnp.concatenate([path.qpos[:1], states.qpos]), ctrls)


def _state(model: Model, start: State, t: Any, before, qpos) -> State:
    """The state at step t that comes from a position to another."""
    h = model.opt.timestep
    return start.replace(
        qpos=qpos, qvel=difference_pos(model, before, qpos, h), time=start.time + h * t
    )
