"""Single shooting: gradients through the whole rollout, given to an optimiser of optax."""

import dataclasses

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from jaxsim.trajopt.plan import Iterate, PlanStatus, first_iterate, keep_best, shifted
from jaxsim.trajopt.problem import Problem


@dataclasses.dataclass(frozen=True)
class Shooting:
    """Descent along the gradient, each step projected onto the limits of the controls.

    Attributes:
      optimizer: any of optax's, line searches and `optax.lbfgs` included.
      iterations: at most so many.
      tolerance: converged when no number of the projected gradient exceeds it.
    """

    optimizer: optax.GradientTransformation = dataclasses.field(
        default_factory=lambda: optax.adam(0.05)
    )
    iterations: int = 500
    tolerance: float = 1e-6

    def start(self, problem: Problem, ctrls: Float[Array, "T nu"], key: jax.Array) -> Iterate:
        """The guess is the first point to evaluate."""
        return first_iterate(problem, ctrls, (ctrls, self.optimizer.init(ctrls)))

    def improve(self, problem: Problem, now: Iterate) -> Iterate:
        """Evaluate a point, keep it if it is the best, and go on to the next."""
        problem = problem.reverse_only()
        ctrls, memory = now.memory

        def value(ctrls):
            states, cost = problem.rollout(ctrls)
            return cost, states

        (cost, states), slope = jax.value_and_grad(value, has_aux=True)(ctrls)
        optimizer = optax.with_extra_args_support(self.optimizer)
        change, memory = optimizer.update(
            slope, memory, ctrls, value=cost, grad=slope, value_fn=lambda c: value(c)[0]
        )
        following = problem.clip(ctrls + change)
        now = keep_best(now, ctrls, states, cost)
        still = jnp.abs(ctrls - problem.clip(ctrls - slope)).max() <= self.tolerance
        status = jnp.where(still, PlanStatus.CONVERGED, PlanStatus.RUNNING)
        usable = jnp.isfinite(cost) & jnp.isfinite(slope).all()
        status = jnp.where(usable, status, PlanStatus.DIVERGED)
        return now.replace(status=status, memory=(following, memory))

    def shift(self, now: Iterate) -> Iterate:
        """The best controls one step later; what the optimiser has learnt of scales stays."""
        ctrls = shifted(now.ctrls)
        return now.replace(
            ctrls=ctrls,
            states=shifted(now.states),
            cost=jnp.full_like(now.cost, jnp.inf),
            memory=(ctrls, now.memory[1]),
        )
