"""`jaxsim optimize` lists tasks, plans, and says whether the goal was reached."""

import dataclasses

import pytest

from jaxsim.cli import main, optimize
from jaxsim.trajopt.tasks import TASKS


def test_lists_tasks(capsys):
    assert main(["optimize"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown and task.about in shown for name, task in TASKS.items())


def test_an_unknown_task_names_the_others(capsys):
    assert main(["optimize", "cartpol"]) == 2
    assert "pendulum, cartpole, acrobot" in capsys.readouterr().err


@pytest.mark.slow
def test_swing_up_with_a_film(tmp_path, capsys):
    file = tmp_path / "pendulum.gif"
    assert main(["optimize", "pendulum", "--out", str(file)]) == 0
    done = capsys.readouterr()
    assert "converged" in done.out
    assert "cost" in done.err.splitlines()[-2] + done.err.splitlines()[0]
    assert str(file) in done.err.replace("\n", "") or "no film" in done.err


@pytest.mark.slow
def test_a_goal_out_of_reach_is_an_exit_status(monkeypatch, capsys):
    impatient = dataclasses.replace(TASKS["pendulum"].method, iterations=1)
    task = dataclasses.replace(TASKS["pendulum"], method=impatient)
    monkeypatch.setitem(optimize.TASKS, "pendulum", task)
    assert main(["optimize", "pendulum", "--no-video"]) == 1
    assert "1 iterations" in capsys.readouterr().out
