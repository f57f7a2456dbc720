"""The tasks of `jaxsim optimize` are solved from small random controls."""

import jax
import numpy as np
import pytest

from jaxsim import trajopt
from jaxsim.lanes import switch
from jaxsim.trajopt.tasks import TASKS


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in TASKS if name != "pendulum"])
def test_solved(name, monkeypatch):
    pytest.importorskip("llvmlite")
    monkeypatch.setattr(switch, "_enabled", True)  # as `jaxsim optimize` does
    task = TASKS[name]
    with jax.enable_x64(task.double):
        problem = task.make()
        plan = trajopt.solve(problem, task.method, starts=task.starts)
        assert task.distance(problem, plan) <= task.goal
    assert np.isfinite(plan.cost)
    assert np.all(np.asarray(plan.ctrls) <= np.asarray(problem.high))
    assert np.all(np.asarray(plan.ctrls) >= np.asarray(problem.low))
