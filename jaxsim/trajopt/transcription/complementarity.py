"""A problem of states and controls, with complementarity as smooth equations.

    c_t = [ x_{t+1} - step(x_t, u_t) ],    F(a, b) = sqrt(a^2 + b^2 + 2 s) - a - b
          [ F(a_t, b_t)              ]

F is zero if and only if a and b are positive with `a b = s` (Fischer and Burmeister; Kanzow 1996).
As s goes to zero, one of the two does. Every step knows only its own states and controls, so the
equations of an optimiser are banded (Posa, Cantu, Tedrake 2014, "A direct method for trajectory
optimization of rigid bodies through contact").
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.batching import vmap
from jaxsim.trajopt.expansion import linearised, second_order
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.space import stack


@struct.dataclass
class StatePath:
    """States and controls, of which the states need not follow.

    Attributes:
      states: x_0, ... x_T.
      ctrls: u_0, ... u_{T-1}.
    """

    states: Any
    ctrls: Float[Array, "T nu"]


def begin_at(path: StatePath, start: Any) -> StatePath:
    """The path with its first state replaced."""
    states = jax.tree.map(lambda x, first: x.at[0].set(first), path.states, start)
    return path.replace(states=states)


def fischer_burmeister(a: Array, b: Array, smoothing: Float[Array, ""]) -> Array:
    """`sqrt(a^2 + b^2 + 2 s) - a - b`."""
    return jnp.sqrt(a * a + b * b + 2 * smoothing) - a - b


@dataclasses.dataclass(frozen=True)
class StatesAndControls:
    """A problem of states and controls; a `Transcription`.

    Attributes:
      problem: the problem.
      smoothing: s.
    """

    problem: Problem
    smoothing: Float[Array, ""]

    @property
    def size(self) -> int:
        """Length of a tangent vector."""
        return self.problem.space.size

    def cost(self, path: StatePath) -> Float[Array, ""]:
        """Cost of a path."""
        return self.problem.total_cost(path.states, path.ctrls)

    def moved(self, path: StatePath, step: Float[Array, "T n+nu"]) -> StatePath:
        """The path with x_1, ... x_T moved, and other controls."""
        retract = jax.vmap(self.problem.space.retract)
        states = retract(_after(path), step[:, : self.size])
        first = jax.tree.map(lambda x: x[0], path.states)
        return StatePath(stack(first, states), path.ctrls + step[:, self.size :])

    def after(self, at: Any, path: StatePath, step: Float[Array, "T n+nu"]) -> StatePath:
        """As `moved`."""
        return self.moved(path, step)

    def gaps(self, path: StatePath) -> Float[Array, "T r"]:
        """c_t."""
        return jax.vmap(self._gap)(_before(path), path.ctrls, _after(path))

    def gap_slopes(self, path: StatePath) -> tuple[Array, Array]:
        """c_t, and its derivative by moves of x_{t-1}, which is zero, x_t, x_{t+1} and u_t."""
        n, space = self.size, self.problem.space

        def gap(z, x, u, y):
            return self._gap(
                space.retract(x, z[:n]), u + z[2 * n :], space.retract(y, z[n : 2 * n])
            )

        origin = np.zeros(2 * n + path.ctrls.shape[1], path.ctrls.dtype)
        slopes, c = vmap(linearised(gap, origin))(_before(path), path.ctrls, _after(path))
        return c, jnp.pad(slopes, ((0, 0), (0, 0), (n, 0)))

    def cost_expansion(self, path: StatePath):
        """Gradients and Hessians of the costs by moves of x_{t-1}, x_t and u_t; of the last one.

        Where a cost is concave it counts as flat.
        """
        problem, n = self.problem, self.size
        retract = problem.space.retract

        def running(z, x, u, t):
            return problem.running_cost(retract(x, z[:n]), u + z[n:], t)

        def final(z, x):
            return problem.final_cost(retract(x, z))

        origin = np.zeros(n + path.ctrls.shape[1], path.ctrls.dtype)
        steps = jnp.arange(problem.horizon)
        each = jax.vmap(second_order(running, origin))(_before(path), path.ctrls, steps)
        last = second_order(final, origin[:n])(jax.tree.map(lambda x: x[-1], path.states))
        return *_behind(n, 1, *each), *_behind(n, 0, *last)

    def products(self, path: StatePath) -> Float[Array, "T m"]:
        """`max(|a b|, -a, -b)` of each pair, by how much complementarity is violated."""
        if self.problem.complementarity is None:
            return jnp.zeros((self.problem.horizon, 0), path.ctrls.dtype)
        a, b = jax.vmap(self.problem.complementarity)(_before(path), path.ctrls, _after(path))
        return jnp.maximum(jnp.abs(a * b), jnp.maximum(-a, -b))

    def _gap(self, x: Any, u: Float[Array, "nu"], y: Any) -> Float[Array, "r"]:
        problem = self.problem
        gap = problem.space.difference(problem.step(x, u), y)
        if problem.complementarity is None:
            return gap
        return jnp.concatenate(
            [gap, fischer_burmeister(*problem.complementarity(x, u, y), self.smoothing)]
        )


def _before(path: StatePath) -> Any:
    return jax.tree.map(lambda x: x[:-1], path.states)


def _after(path: StatePath) -> Any:
    return jax.tree.map(lambda x: x[1:], path.states)


def _behind(n: int, batch: int, gradient: Array, hessian: Array) -> tuple[Array, Array]:
    """Derivatives by one more state before the others, which are zero."""
    before = (n, 0)
    none = ((0, 0),) * batch
    return jnp.pad(gradient, (*none, before)), jnp.pad(hessian, (*none, before, before))
