"""`jaxsim optimize`: plan a motion, say how it went, and film it."""

import argparse
import pathlib
import time

import jax

from jaxsim.cli import UsageError
from jaxsim.cli.report import listing, note, report, working
from jaxsim.cli.simulate import prepare_cpu
from jaxsim.trajopt import Plan, PlanStatus, Problem, solve
from jaxsim.trajopt.tasks import TASKS, Task, model_of
from jaxsim.viz import film


def run(arguments: argparse.Namespace) -> int:
    """Solve a task; returns 1 if its goal was not reached."""
    if arguments.task is None:
        listing("task", (), "what happens", ((name, task.about) for name, task in TASKS.items()))
        return 0
    if arguments.task not in TASKS:
        raise UsageError(f"there is no task {arguments.task!r}; there are {', '.join(TASKS)}")
    prepare_cpu()
    task = TASKS[arguments.task]
    with jax.enable_x64(task.double):
        return _solved(arguments, task)


def _solved(arguments: argparse.Namespace, task: Task) -> int:
    """Plan, report and film; 1 if the goal was not reached."""
    start = time.perf_counter()
    problem = task.make()
    key = jax.random.key(arguments.seed)
    plan = solve(problem, task.method, key=key, starts=task.starts, progress=True)
    seconds = time.perf_counter() - start
    distance = task.distance(problem, plan)
    report(_rows(arguments.task, task, plan, distance, seconds))
    if arguments.video:
        note(_film(arguments, problem, plan))
    return int(not distance <= task.goal)


def _rows(name: str, task: Task, plan: Plan, distance: float, seconds: float) -> dict[str, str]:
    made = int(plan.iterations)
    return {
        "task": f"{name}: {task.about}",
        "method": f"{type(task.method).__name__}, the best of {task.starts} starts",
        "cost": f"{plan.history[0]:.4g} -> {plan.cost:.4g} in {made} iterations",
        "status": PlanStatus(int(plan.status)).name.lower(),
        "distance from the goal": f"{distance:.3g}, of which {task.goal:g} are allowed",
        "time, with compilation": f"{seconds:.1f} s",
    }


def _film(arguments: argparse.Namespace, problem: Problem, plan: Plan) -> str:
    path = arguments.out or pathlib.Path(f"{arguments.task}.mp4")
    try:
        with working("drawing the motion"):
            return f"film: {film(model_of(problem), plan.states, path)}"
    except (RuntimeError, ValueError) as error:
        return f"no film: {error}"
