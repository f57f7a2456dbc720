"""The tasks of `jaxsim optimize` are solved from small random controls."""

import numpy as np
import pytest

from jaxsim import trajopt
from jaxsim.trajopt.tasks import TASKS


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in TASKS if name != "pendulum"])
def test_solved(name):
    task = TASKS[name]
    problem = task.make()
    plan = trajopt.solve(problem, task.method)
    assert task.distance(problem, plan) <= task.goal
    assert np.isfinite(plan.cost)
    assert np.all(plan.ctrls <= problem.high)
    assert np.all(plan.ctrls >= problem.low)
