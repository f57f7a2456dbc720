"""Methods of trajectory optimisation side by side, on the tasks of `jaxsim optimize`.

All start from the same small random controls. Cost is that of the best controls so far against
iterations, simulated steps and wall time, compilation included. A simulated step is one of the
dynamics with a control: iLQR takes ten for its step lengths and one for its derivatives, a gradient
one, a sampler one for each sample. A cost counts as reached when it is at most 10 per cent above
the best of all methods.
"""

import argparse
import functools
import time

import common
import numpy as np
import optax

COLUMNS = "method", "compile s", "iterations", "last cost", "miss", "to 10 %", "in steps", "in s"


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup(devices=2)
    rows = []
    for name in options.tasks:
        rows += _task(name, options)
        print(common.table([r for r in rows if r["task"] == name], COLUMNS), flush=True)
    common.write(options, __file__, {"rows": rows}, functools.partial(_draw, rows=rows))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=1)
    names = ["pendulum", "cartpole", "acrobot"]
    parser.add_argument("--tasks", nargs="+", default=names, metavar="TASK")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each method, compiled")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args(arguments)


def _methods() -> dict:
    """Methods by name, and the simulated steps of an iteration over the horizon."""
    from jaxsim import trajopt

    long = {"iterations": 100_000, "samples": 64}
    return {
        "iLQR": (trajopt.ILQR(iterations=300), 11),
        "Adam": (trajopt.Shooting(optax.adam(0.05), iterations=100_000), 1),
        "predictive sampling": (trajopt.PredictiveSampling(**long), 64),
        "MPPI": (trajopt.MPPI(**long), 64),
        "CEM": (trajopt.CEM(**long), 64),
    }


def _task(name: str, options) -> list[dict]:
    from jaxsim.trajopt.tasks import TASKS

    task = TASKS[name]
    problem = task.make()
    rows = []
    for label, (method, steps) in _methods().items():
        row = {"task": name, "method": label} | _run(task, problem, method, options)
        row["steps"] = [steps * problem.horizon * (i + 1) for i in range(len(row["cost"]))]
        rows.append(row)
    best = min(row["cost"][-1] for row in rows)
    for row in rows:
        row |= _summary(row, 1.1 * best)
        kept = np.unique(np.geomspace(1, len(row["cost"]), 100).astype(int)) - 1
        row["iteration"] = (kept + 1).tolist()
        for column in ("cost", "seconds", "steps"):
            row[column] = [row[column][i] for i in kept]
    return rows


def _run(task, problem, method, options) -> dict:
    """Cost and time after each iteration, until the method or the time comes to its end."""
    import jax

    from jaxsim.trajopt import PlanStatus

    start = time.perf_counter()
    first, rest = jax.random.split(jax.random.key(options.seed))
    now = method.start(problem, problem.random_ctrls(first), rest)
    improve = jax.jit(lambda now: method.improve(problem, now)).lower(now).compile()
    compiled = time.perf_counter() - start
    cost, seconds = [], [compiled]
    while len(cost) < method.iterations and seconds[-1] < compiled + options.seconds:
        now = jax.block_until_ready(improve(now))
        cost.append(float(now.cost))
        seconds.append(time.perf_counter() - start)
        if int(now.status) != PlanStatus.RUNNING:
            break
    last = jax.tree.map(lambda x: x[-1], now.states)
    miss = float(task.miss(problem.space.model, last))
    return {"compile s": compiled, "cost": cost, "seconds": seconds[1:], "miss": miss}


def _summary(row: dict, goal: float) -> dict:
    """When a cost was reached."""
    there = np.flatnonzero(np.array(row["cost"]) <= goal)
    at = {"to 10 %": None, "in steps": None, "in s": None}
    if there.size:
        i = int(there[0])
        at = {"to 10 %": i + 1, "in steps": row["steps"][i], "in s": row["seconds"][i]}
    return {"last cost": row["cost"][-1], "iterations": len(row["cost"])} | at


def _draw(figure, rows: list[dict]) -> None:
    tasks = list(dict.fromkeys(row["task"] for row in rows))
    figure.set_size_inches(12, 3.2 * len(tasks))
    grid = figure.subplots(len(tasks), 3, squeeze=False)
    for task, line in zip(tasks, grid, strict=True):
        for row in (r for r in rows if r["task"] == task):
            xs = (row["iteration"], row["steps"], row["seconds"])
            for axes, x in zip(line, xs, strict=True):
                axes.loglog(x, row["cost"], label=row["method"])
        line[0].set_ylabel(f"cost of {task}")
    for axes, label in zip(grid[-1], ("iterations", "simulated steps", "seconds"), strict=True):
        axes.set_xlabel(label)
    for axes in grid[:, 2]:  # so few decades that numbers in between would overlap
        axes.xaxis.set_minor_formatter("")
    grid[0, 0].legend()


if __name__ == "__main__":
    main()
