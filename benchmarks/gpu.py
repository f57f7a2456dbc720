"""Everything that is claimed of GPUs, on the device at hand, within some minutes: one command.

Errors against MuJoCo C, and of a gradient against float64 on the CPU. Steps per second of each
engine that is installed (jaxsim with one kernel for a step, or by XLA with the lanes last or first,
with loops in command buffers and without; MJX; mujoco_warp with graph capture), of a gradient, and
of training. Each job is a process of its own, so that one that fails stops no other; its lines come
as they are known. All programs are compiled first, many at a time, into a cache; then each job has
the device for itself. Those that were not compiled in time come last, and say so if none is left.

examples:
  python benchmarks/gpu.py                    eight minutes on a GPU
  python benchmarks/gpu.py --cpu              the same on a CPU in tiny sizes: that it works
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import common

WORKER = pathlib.Path(__file__).parent / "gpu_worker.py"
ENGINES = ("kernel", "lanes last", "MJX", "mujoco_warp", "lanes first")
COLUMNS = ("kind", "model", "engine", "batch", "note", "steps/s", "spread %", "qacc error")
COLUMNS += ("gradient error", "return", "seconds", "compile s", "temporary kB", "memory MB", "why")
KINDS = "check", "rate", "gradient", "train"
STATES = 16  # at which errors are measured
RESERVE = 15  # seconds that a job needs at least


def main(arguments=None) -> None:
    options = _options(arguments)
    jobs = _tiny_jobs(options) if options.cpu else _jobs(options)
    jobs = [job for job in jobs if job["kind"] in options.kinds]
    end = time.monotonic() + 60 * options.minutes
    with tempfile.TemporaryDirectory() as cache:
        environment = _environment(options, cache)
        compiled = _prepare(jobs, environment, end)
        found = []
        order = sorted(range(len(jobs)), key=lambda i: "why" in compiled[i][0])
        for i in order:
            seconds = {r["batch"]: r["compile s"] for r in compiled[i] if "compile s" in r}
            for row in _run(jobs[i], environment, end):
                known = {k: v for k, v in jobs[i].items() if k not in ("set", "repetitions")}
                once = {"compile s": seconds[row["batch"]]} if row["batch"] in seconds else {}
                found.append(known | once | row)
                print(common.table([found[-1]], [c for c in COLUMNS if c in found[-1]]), flush=True)
    print(common.table(found, COLUMNS))
    common.write(options, __file__, {"rows": found})


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=7)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--cpu", action="store_true", help="tiny sizes on a CPU, no files")
    parser.add_argument("--minutes", type=float, default=8, help="time for all rows (8)")
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS, help="which rows")
    parser.add_argument("--steps", type=int, default=50, help="steps of a rollout")
    options = parser.parse_args(arguments)
    options.dry |= options.cpu  # rates of tiny sizes must not take the place of a GPU's
    return options


def _jobs(options) -> list[dict]:
    """The most important ones first."""
    models = "humanoid", "half_cheetah", "ant", "hopper"
    usual = 8192, 32768
    check = lambda m, e: _row("check", m, e, STATES)  # noqa: E731
    kernels = [_rate(options, m, "kernel", *usual) for m in models[1:]]
    kernels.insert(0, _rate(options, "humanoid", "kernel", *usual, 131072))
    kernels.append(_rate(options, "gymnasium_humanoid", "kernel", *usual))
    training = [_row("train", m, "ppo", 0, set=[]) for m in ("half_cheetah", "humanoid")]
    others = [_rate(options, m, e, *usual) for e in ("lanes last", "MJX") for m in models]
    short = [_rate(options, "humanoid", e, 8192, iterations=1) for e in ENGINES[:3]]
    gradient = [_row("gradient", "humanoid", e, 4096, repetitions=3) for e in ENGINES[1:3]]
    rest = [_rate(options, m, "mujoco_warp", *usual) for m in models]
    rest += [_rate(options, m, "lanes last", 8192, host_loops=True) for m in models]
    rest += [_rate(options, m, "lanes first", 8192) for m in models]
    rest += [check(m, e) for e in ENGINES[1:] for m in models if (m, e) != ("ant", "MJX")]
    return [
        *(check(m, "kernel") for m in models),
        *kernels,
        *training,
        *others,
        *short,
        *gradient,
        *rest,
    ]


def _tiny_jobs(options) -> list[dict]:
    """One of each kind."""
    options.steps = 3
    tiny = ["envs=8", "unroll=4", "minibatches=2", "passes=1", "total_steps=256", "evaluations=1"]
    tiny += ["evaluation_episodes=2", "policy.hidden=[4]", "value.hidden=[4]"]
    return [
        _row("check", "double_pendulum", "kernel", STATES),
        _row("check", "double_pendulum", "lanes last", STATES),
        _rate(options, "double_pendulum", "kernel", 8, 16),
        _rate(options, "double_pendulum", "lanes last", 8),
        _rate(options, "double_pendulum", "mujoco_warp", 8),
        _row("gradient", "double_pendulum", "lanes last", 4, repetitions=1),
        _row("train", "fast", "ppo", 0, set=tiny),
    ]


def _row(kind: str, model: str, engine: str, *batches: int, **more) -> dict:
    return {"kind": kind, "model": model, "engine": engine, "batch": batches, **more}


def _rate(options, model: str, engine: str, *batches: int, **more) -> dict:
    settings = {"steps": options.steps, "repetitions": options.repetitions}
    if "host_loops" in more:
        settings["note"] = "loops outside command buffers"
    if "iterations" in more:
        settings["note"] = f"iterations={more['iterations']}"
    return _row("rate", model, engine, *batches, **settings, **more)


def _environment(options, cache: str) -> dict[str, str]:
    environment = dict(os.environ)
    environment["JAX_COMPILATION_CACHE_DIR"] = cache
    environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    environment["XLA_PYTHON_CLIENT_PREALLOCATE"] = "false"
    if options.cpu:
        environment["JAX_PLATFORMS"] = "cpu"
    return environment


def _prepare(jobs: list[dict], environment: dict, end: float) -> list[list[dict]]:
    """Compiles all jobs, as many at a time as there are pairs of cores, in their order."""
    workers = max(1, (os.cpu_count() or 2) // 2)
    # Half of the time at most: what is not compiled by then is compiled when its turn comes.
    until = time.monotonic() + (end - time.monotonic()) / 2

    def prepare(job: dict) -> list[dict]:
        rows = _work(job, environment, until, "--prepare")
        if "why" in rows[-1]:  # said at once: there may be time to mend it
            print(
                f"{job['kind']} of {job['model']} by {job['engine']}: {rows[-1]['why']}", flush=True
            )
        return rows

    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        return list(pool.map(prepare, jobs))


def _run(job: dict, environment: dict, end: float) -> list[dict]:
    if end - time.monotonic() < RESERVE:
        return [{"batch": job["batch"][0], "why": "no time left"}]
    return _work(job, environment, end)


def _work(job: dict, environment: dict, end: float, *words: str) -> list[dict]:
    """The rows that a worker finds, and why there are no more."""
    command = [sys.executable, str(WORKER), json.dumps(job), *words]
    why = ""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as worker:
        try:
            out, err = worker.communicate(timeout=max(1.0, end - time.monotonic()))
        except subprocess.TimeoutExpired:
            worker.kill()
            out, err = worker.communicate()
            why = "took too long"
    rows = [json.loads(line) for line in out.splitlines() if line.startswith("{")]
    if worker.returncode and not why:
        said = [line for line in err.splitlines() if "Error" in line]
        why = said[-1] if said else f"exit status {worker.returncode}"
    missing = job["batch"][len(rows) :]
    return [*rows, {"batch": missing[0], "why": why}] if why and missing else rows


if __name__ == "__main__":
    main()
