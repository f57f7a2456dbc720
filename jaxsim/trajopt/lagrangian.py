"""The augmented Lagrangian of a path: costs, the missing forces, and the limits on controls.

    L = cost + sum 1/2 rho |c + lambda / rho|^2 + sum 1/2 rho |max(0, g + mu / rho)|^2

with c the missing forces and g what controls are beyond their limits (Hestenes 1969, Powell 1969).
Minimised over the path, and with `lambda + rho c` as the next multipliers, c goes to zero.
"""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.constraint.laws import Blur
from jaxsim.model import Model
from jaxsim.trajopt.banded import Pentadiagonal, assemble, assemble_vector
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.three_point import Path, cost_expansion, gap_slopes, states_of

# Sets of limits that a step tries; two or three are usual.
_ACTIVE_SETS = 10


@struct.dataclass
class Multipliers:
    """Multipliers and the penalty.

    Attributes:
      missing: lambda, of the missing forces.
      above: mu, of the upper limits.
      below: mu, of the lower limits.
      penalty: rho.
    """

    missing: Float[Array, "T nv"]
    above: Float[Array, "T nu"]
    below: Float[Array, "T nu"]
    penalty: Float[Array, ""]

    def updated(self, problem: Problem, ctrls: Array, c: Array) -> "Multipliers":
        """The next multipliers."""
        above, below = self.pushes(problem, ctrls)
        return self.replace(missing=self.missing + self.penalty * c, above=above, below=below)

    def pushes(self, problem: Problem, ctrls: Float[Array, "T nu"]) -> tuple[Array, Array]:
        """`max(0, mu + rho g)` of the upper and of the lower limits."""
        above, below = self.bounds(problem, ctrls)
        return jnp.maximum(above, 0), jnp.maximum(below, 0)

    def bounds(self, problem: Problem, ctrls: Float[Array, "T nu"]) -> tuple[Array, Array]:
        """`mu + rho g` of the upper and of the lower limits, positive where they act."""
        above = self.above + self.penalty * (ctrls - problem.high[None])
        below = self.below + self.penalty * (problem.low[None] - ctrls)
        return above, below


def excess(problem: Problem, ctrls: Float[Array, "T nu"]) -> Float[Array, ""]:
    """The most by which a control is beyond its limits."""
    beyond = jnp.maximum(ctrls - problem.high[None], problem.low[None] - ctrls)
    return jnp.max(beyond, initial=0)


def lagrangian(
    model: Model, problem: Problem, multipliers: Multipliers, path: Path, c: Float[Array, "T nv"]
) -> Float[Array, ""]:
    """L of a path with missing forces c."""
    rho = multipliers.penalty
    cost = problem.total_cost(states_of(model, path, problem.start), path.ctrls)
    forces = (multipliers.missing + rho * c, *multipliers.pushes(problem, path.ctrls))
    return cost + sum(jnp.sum(f * f) for f in forces) / (2 * rho)


@struct.dataclass
class Expansion:
    """A path's Lagrangian to second order, and its missing forces to first.

    Attributes:
      gradient: of L without limits, by moves of q_1 ... q_T and u_0 ... u_{T-1}.
      hessian: of L without limits, Gauss-Newton.
      above: `mu + rho g` of the upper limits.
      below: the same of the lower limits.
      penalty: rho.
      missing: c.
      slopes: of c_t by moves of q_{t-1}, q_t and q_{t+1} and by u_t.
    """

    gradient: Float[Array, "T nv+nu"]
    hessian: Pentadiagonal
    above: Float[Array, "T nu"]
    below: Float[Array, "T nu"]
    penalty: Float[Array, ""]
    missing: Float[Array, "T nv"]
    slopes: Float[Array, "T nv 3*nv+nu"]

    def step(self, damping: Float[Array, ""]) -> Float[Array, "T nv+nu"]:
        """The minimiser of the expansion plus `1/2 damping |step|^2`.

        Limits act or not: which of them do at the minimiser is found by trying those that act at
        the last one (primal-dual active sets; Hintermueller, Ito, Kunisch 2003).
        """
        nv, rho = self.missing.shape[1], self.penalty

        def acting(step):
            change = rho * step[:, nv:]
            return self.above + change > 0, self.below - change > 0

        def again(state):
            step, (up, down), _, count = state
            step = self._step_with(damping, up, down)
            sets = acting(step)
            changed = jnp.any(sets[0] != up) | jnp.any(sets[1] != down)
            return step, sets, changed, count + 1

        none = jnp.zeros_like(self.gradient)
        start = none, acting(none), jnp.ones((), bool), 0
        return lax.while_loop(lambda s: s[2] & (s[3] < _ACTIVE_SETS), again, start)[0]

    def _step_with(self, damping, up: Array, down: Array) -> Float[Array, "T nv+nu"]:
        """The same if it is known which upper and lower limits act."""
        nv = self.missing.shape[1]
        push = jnp.where(up, self.above, 0) - jnp.where(down, self.below, 0)
        held = jnp.where(up | down, self.penalty, 0)
        stiffness = damping + jnp.pad(held, ((0, 0), (nv, 0)))
        diagonal = self.hessian.diagonal + jax.vmap(jnp.diag)(stiffness)
        held_at = self.hessian._replace(diagonal=diagonal)
        return -held_at.solve(self.gradient.at[:, nv:].add(push))

    def missing_after(self, step: Float[Array, "T nv+nu"]) -> Float[Array, "T nv"]:
        """The missing forces to first order."""
        nv = self.missing.shape[1]
        q = jnp.pad(step[:, :nv], ((2, 0), (0, 0)))
        z = jnp.concatenate([q[:-2], q[1:-1], q[2:], step[:, nv:]], axis=1)
        return self.missing + jnp.einsum("tci,ti->tc", self.slopes, z)


def expand_lagrangian(
    model: Model, problem: Problem, multipliers: Multipliers, path: Path, blur: Blur | None
) -> Expansion:
    """The expansion at a path; a cost counts as flat where it is concave."""
    nv, nu, rho = model.nv, model.nu, multipliers.penalty
    c, J = gap_slopes(model, problem, path, blur)
    # Local unknowns: moves of q_{t-1}, q_t and q_{t+1}, and u_t.
    cost = np.r_[0 : 2 * nv, 3 * nv : 3 * nv + nu]
    g, H, g_final, H_final = cost_expansion(model, problem, path)
    gradient = jnp.einsum("tci,tc->ti", J, multipliers.missing + rho * c)
    gradient = gradient.at[:, cost].add(g)
    hessian = rho * jnp.einsum("tci,tcj->tij", J, J)
    hessian = hessian.at[:, cost[:, None], cost].add(H)
    last = 2 * nv
    g_all = jnp.pad(gradient, ((0, 1), (0, 0))).at[-1, :last].set(g_final)
    H_all = jnp.pad(hessian, ((0, 1), (0, 0), (0, 0))).at[-1, :last, :last].set(H_final)
    limits = multipliers.bounds(problem, path.ctrls)
    return Expansion(*_in_blocks(nv, nu, g_all, H_all), *limits, rho, c, J)


def _in_blocks(nv: int, nu: int, gradient: Array, hessian: Array) -> tuple[Array, Pentadiagonal]:
    """The sum of local quadratics; a block of unknowns is q_t with u_{t-1}."""
    T, m = len(gradient) - 1, nv + nu
    at = np.r_[0:nv, m : m + nv, 2 * m : 2 * m + nv, 2 * m + nv : 3 * m]
    g = jnp.zeros((T + 1, 3 * m), gradient.dtype).at[:, at].set(gradient)
    H = jnp.zeros((T + 1, 3 * m, 3 * m), gradient.dtype).at[:, at[:, None], at].set(hessian)
    return assemble_vector(g.reshape(T + 1, 3, m)), assemble(H.reshape(T + 1, 3, m, 3, m))
