"""Methods that draw controls at random and keep what is cheap; they need no derivatives.

All draw `samples` control sequences around a mean, one of which is the mean itself. What is drawn
is noise at a few knots, joined by straight lines, so that the controls do not jitter.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.batching import vmap
from jaxsim.trajopt.plan import Iterate, PlanStatus, first_iterate, keep_best, shifted
from jaxsim.trajopt.problem import Problem


class _Memory(NamedTuple):
    """Where the next samples are drawn: mean and spread of the controls."""

    mean: Float[Array, "T nu"]
    spread: Float[Array, "T nu"]
    key: jax.Array


@dataclasses.dataclass(frozen=True)
class Sampler:
    """What the samplers share; a subclass says where to draw next.

    Attributes:
      iterations: how many.
      samples: control sequences of an iteration.
      knots: how many points in time the noise is drawn at; those of the horizon if it is shorter.
      noise: standard deviation, as a part of half of the controls' range (or of 1 without one).
    """

    iterations: int = 200
    samples: int = 64
    knots: int = 16
    noise: float = 0.3

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """Samples will be drawn around the guess."""
        spread = jnp.broadcast_to(self.noise * problem.half_range, ctrls.shape)
        return first_iterate(problem, ctrls, _Memory(ctrls, spread, key))

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """Draw, evaluate, move the mean; the best controls so far are the result."""
        mean, spread, key = now.memory
        key, draw = jax.random.split(key)
        noise = self._noise(draw, mean).at[0].set(0)
        ctrls = jax.vmap(problem.clip)(mean[None] + spread[None] * noise)
        states, costs = vmap(problem.rollout)(ctrls)
        costs = jnp.where(jnp.isnan(costs), jnp.inf, costs)
        best = jnp.argmin(costs)
        ctrl, states = jax.tree.map(lambda x: x[best], (ctrls, states))
        now = keep_best(now, ctrl, states, costs[best])
        mean, spread = self.update(problem, now, ctrls, costs)
        status = jnp.where(jnp.isfinite(now.cost), PlanStatus.RUNNING, PlanStatus.DIVERGED)
        return now.replace(status=status, memory=_Memory(mean, spread, key))

    def shift(self, now: Iterate) -> Iterate:
        """The mean one step later."""
        return now.replace(
            ctrls=shifted(now.ctrls),
            states=shifted(now.states),
            cost=jnp.full_like(now.cost, jnp.inf),
            memory=now.memory._replace(
                mean=shifted(now.memory.mean), spread=shifted(now.memory.spread)
            ),
        )

    def update(
        self, problem: Problem, now: Iterate, ctrls: Float[Array, "S T nu"], costs: Array
    ) -> tuple[Any, Any]:
        """Mean and spread of the next samples."""
        raise NotImplementedError

    def _noise(self, key: jax.Array, mean: Float[Array, "T nu"]) -> Float[Array, "S T nu"]:
        horizon, nu = mean.shape
        knots = min(self.knots, horizon)
        noise = jax.random.normal(key, (self.samples, knots, nu), mean.dtype)
        at = jnp.linspace(0, knots - 1, horizon, dtype=mean.dtype)
        # Row t has the weights of the two knots that time t lies between.
        weights = jnp.maximum(0, 1 - jnp.abs(at[:, None] - jnp.arange(knots)[None]))
        return jnp.einsum("tk,sku->stu", weights, noise)


@dataclasses.dataclass(frozen=True)
class PredictiveSampling(Sampler):
    """The next mean is the best of all samples (Howell et al. 2022)."""

    def update(self, problem, now, ctrls, costs):
        """The best so far; the spread stays."""
        return now.ctrls, now.memory.spread


@dataclasses.dataclass(frozen=True)
class MPPI(Sampler):
    """The next mean is an average with weights `exp(-cost / temperature)` (Williams et al. 2017).

    Attributes:
      temperature: relative to the standard deviation of the costs of an iteration.
    """

    temperature: float = 0.1

    def update(self, problem, now, ctrls, costs):
        """The weighted mean; the spread stays."""
        finite = jnp.isfinite(costs)
        scale = jnp.std(costs, where=finite) + jnp.finfo(costs.dtype).tiny
        weights = jax.nn.softmax(-(costs - now.cost) / (self.temperature * scale))
        return jnp.einsum("s,stu->tu", weights, ctrls), now.memory.spread


@dataclasses.dataclass(frozen=True)
class CEM(Sampler):
    """Cross-entropy method: mean and spread of the next samples are those of the best few.

    Attributes:
      elites: how many.
      smoothing: part of the old spread that is kept.
      least_noise: the spread never falls below this part of the first one.
    """

    elites: int = 8
    smoothing: float = 0.5
    least_noise: float = 0.05

    def update(self, problem, now, ctrls, costs):
        """Mean and standard deviation of the cheapest samples."""
        best = ctrls[jnp.argsort(costs)[: self.elites]]
        kept = self.smoothing * now.memory.spread + (1 - self.smoothing) * best.std(0)
        least = self.least_noise * self.noise * problem.half_range
        return best.mean(0), jnp.maximum(kept, least[None])
