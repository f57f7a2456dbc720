"""The augmented Lagrangian of a path: costs, constraints, and the limits on controls.

    L = cost + sum 1/2 rho |c + lambda / rho|^2 + sum 1/2 rho |max(0, g + mu / rho)|^2

with c what is to be zero, such as missing forces, and g what controls are beyond their limits
(Hestenes 1969, Powell 1969). Minimised over the path, and with `lambda + rho c` as the next
multipliers, c goes to zero.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.trajopt.plan import shifted
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.transcription.banded import Pentadiagonal, assemble, assemble_vector
from jaxsim.trajopt.transcription.protocol import Transcription

# Sets of limits that a step tries; two or three are usual.
_ACTIVE_SETS = 10


@struct.dataclass
class Multipliers:
    """Multipliers and the penalty.

    Attributes:
      missing: lambda, of the constraints.
      above: mu, of the upper limits.
      below: mu, of the lower limits.
      penalty: rho.
    """

    missing: Float[Array, "T r"]
    above: Float[Array, "T nu"]
    below: Float[Array, "T nu"]
    penalty: Float[Array, ""]

    def updated(self, problem: Problem, ctrls: Array, c: Array) -> "Multipliers":
        """The next multipliers."""
        above, below = self.pushes(problem, ctrls)
        return self.replace(missing=self.missing + self.penalty * c, above=above, below=below)

    def shifted(self) -> "Multipliers":
        """Those of one step later."""
        late = {name: shifted(getattr(self, name)) for name in ("missing", "above", "below")}
        return self.replace(**late)

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
    way: Transcription, multipliers: Multipliers, path: Any, c: Float[Array, "T r"]
) -> Float[Array, ""]:
    """L of a path with constraints c."""
    rho = multipliers.penalty
    forces = (multipliers.missing + rho * c, *multipliers.pushes(way.problem, path.ctrls))
    return way.cost(path) + sum(jnp.sum(f * f) for f in forces) / (2 * rho)


@struct.dataclass
class Expansion:
    """A path's Lagrangian to second order, and its constraints to first.

    Attributes:
      gradient: of L without limits, by moves of q_1 ... q_T and u_0 ... u_{T-1}.
      hessian: of L without limits, Gauss-Newton.
      above: `mu + rho g` of the upper limits.
      below: the same of the lower limits.
      penalty: rho.
      missing: c.
      slopes: of c_t by moves of q_{t-1}, q_t and q_{t+1} and by u_t.
    """

    gradient: Float[Array, "T n+nu"]
    hessian: Pentadiagonal
    above: Float[Array, "T nu"]
    below: Float[Array, "T nu"]
    penalty: Float[Array, ""]
    missing: Float[Array, "T r"]
    slopes: Float[Array, "T r 3*n+nu"]

    @property
    def _size(self) -> int:
        """Length of a move of a position."""
        return self.gradient.shape[1] - self.above.shape[1]

    def step(self, damping: Float[Array, ""]) -> Float[Array, "T n+nu"]:
        """The minimiser of the expansion plus `1/2 damping |step|^2`.

        Limits act or not: which of them do at the minimiser is found by trying those that act at
        the last one (primal-dual active sets; Hintermueller, Ito, Kunisch 2003).
        """
        n, rho = self._size, self.penalty

        def acting(step):
            change = rho * step[:, n:]
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

    def _step_with(self, damping, up: Array, down: Array) -> Float[Array, "T n+nu"]:
        """The same if it is known which upper and lower limits act."""
        n = self._size
        push = jnp.where(up, self.above, 0) - jnp.where(down, self.below, 0)
        held = jnp.where(up | down, self.penalty, 0)
        stiffness = damping + jnp.pad(held, ((0, 0), (n, 0)))
        diagonal = self.hessian.diagonal + jax.vmap(jnp.diag)(stiffness)
        held_at = self.hessian._replace(diagonal=diagonal)
        return -held_at.solve(self.gradient.at[:, n:].add(push))

    def missing_after(self, step: Float[Array, "T n+nu"]) -> Float[Array, "T r"]:
        """The constraints to first order."""
        n = self._size
        q = jnp.pad(step[:, :n], ((2, 0), (0, 0)))
        z = jnp.concatenate([q[:-2], q[1:-1], q[2:], step[:, n:]], axis=1)
        return self.missing + jnp.einsum("tci,ti->tc", self.slopes, z)


def expand_lagrangian(way: Transcription, multipliers: Multipliers, path: Any) -> Expansion:
    """The expansion at a path; a cost counts as flat where it is concave."""
    n, nu, rho = way.size, path.ctrls.shape[1], multipliers.penalty
    c, J = way.gap_slopes(path)
    # Local unknowns: moves of q_{t-1}, q_t and q_{t+1}, and u_t.
    cost = np.r_[0 : 2 * n, 3 * n : 3 * n + nu]
    g, H, g_final, H_final = way.cost_expansion(path)
    gradient = jnp.einsum("tci,tc->ti", J, multipliers.missing + rho * c)
    gradient = gradient.at[:, cost].add(g)
    hessian = rho * jnp.einsum("tci,tcj->tij", J, J)
    hessian = hessian.at[:, cost[:, None], cost].add(H)
    last = 2 * n
    g_all = jnp.pad(gradient, ((0, 1), (0, 0))).at[-1, :last].set(g_final)
    H_all = jnp.pad(hessian, ((0, 1), (0, 0), (0, 0))).at[-1, :last, :last].set(H_final)
    limits = multipliers.bounds(way.problem, path.ctrls)
    return Expansion(*in_blocks(n, nu, g_all, H_all), *limits, rho, c, J)


def in_blocks(nv: int, nu: int, gradient: Array, hessian: Array) -> tuple[Array, Pentadiagonal]:
    """The sum of local quadratics; a block of unknowns is q_t with u_{t-1}."""
    T, m = len(gradient) - 1, nv + nu
    at = np.r_[0:nv, m : m + nv, 2 * m : 2 * m + nv, 2 * m + nv : 3 * m]
    g = jnp.zeros((T + 1, 3 * m), gradient.dtype).at[:, at].set(gradient)
    H = jnp.zeros((T + 1, 3 * m, 3 * m), gradient.dtype).at[:, at[:, None], at].set(hessian)
    return assemble_vector(g.reshape(T + 1, 3, m)), assemble(H.reshape(T + 1, 3, m, 3, m))
