"""Differential dynamic programming: iLQR with the second derivatives of the dynamics."""

import dataclasses

from jaxsim.trajopt.expansion import Expansion, curvature_of_dynamics, expand, points_of
from jaxsim.trajopt.ilqr import ILQR
from jaxsim.trajopt.plan import Iterate
from jaxsim.trajopt.problem import Problem
from jaxsim.trajopt.riccati import Policy, backward


@dataclasses.dataclass(frozen=True)
class DDP(ILQR):
    """Differential dynamic programming (Mayne 1966), with bounds on controls as `ILQR` has them.

    Near a solution each iteration squares the error, where iLQR multiplies it by a factor if
    dynamics are curved and the cost at the end is not small. An iteration costs several times as
    much: the Hessian of each step along a costate that the steps after it decide, one by one.

    Attributes:
      iterations: at most so many.
      tolerance: converged when the expansion promises less than this part of 1 + |cost|, and states
        have no gaps.
      damping: of the first iteration; see `jaxsim.trajopt.riccati`.
      states: first guess of the states (T+1, ...), as for `ILQR`.
    """

    def _expansion(self, problem: Problem, now: Iterate) -> Expansion:
        return expand(problem, now.states, now.ctrls, convex=False)

    def _policy(
        self, problem: Problem, now: Iterate, near: Expansion, low, high, damping
    ) -> Policy:
        points = points_of(now.states, now.ctrls)
        return backward(near, low, high, damping, curvature_of_dynamics(problem), points)
