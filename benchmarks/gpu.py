"""Everything that is claimed of GPUs, on the device at hand, within some minutes: one command.

Correctness first: errors against MuJoCo C with the lanes last and first, of a gradient against
float64 on the CPU. Then steps per second of each engine that is installed (jaxsim in both layouts,
with loops in command buffers, as it compiles them, and without; MJX; mujoco_warp with graph
capture), of a gradient, and of training. Each row is a process of its own, so that one that fails
stops no other; its lines come as they are known. All programs are compiled first, many at a time,
into a cache; then each row has the device for itself. Rows for which no time is left say so.

examples:
  python benchmarks/gpu.py                    eight minutes on a GPU
  python benchmarks/gpu.py --cpu --dry        the same on a CPU in tiny sizes: that it works
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
COLUMNS += ("gradient error", "return", "compile s", "temporary kB", "memory MB", "why")
SCALE = ["envs=4096", "unroll=16", "minibatches=16", "passes=4", "total_steps=6_000_000"]
RESERVE = 15  # seconds that a row needs at least


def main(arguments=None) -> None:
    options = _options(arguments)
    rows = _tiny_rows(options) if options.cpu else _rows(options)
    end = time.monotonic() + 60 * options.minutes
    with tempfile.TemporaryDirectory() as cache:
        environment = _environment(options, cache)
        compiled = _prepare(rows, environment, end)
        found = []
        for row, seconds in zip(rows, compiled, strict=True):
            found.append(row | seconds | _run(row, environment, end))
            print(common.table([found[-1]], [c for c in COLUMNS if c in found[-1]]), flush=True)
    print(common.table(found, COLUMNS))
    common.write(options, __file__, {"rows": found})


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=7)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--cpu", action="store_true", help="tiny sizes on a CPU")
    parser.add_argument("--minutes", type=float, default=8, help="time for all rows (8)")
    parser.add_argument("--steps", type=int, default=50, help="steps of a rollout")
    return parser.parse_args(arguments)


def _rows(options) -> list[dict]:
    """The most important ones first."""
    models = "humanoid", "half_cheetah", "ant", "hopper"
    checks = [_row("check", m, e) for m in models for e in ENGINES if e != "MJX" or m != "ant"]
    rates = []
    for batch in (8192, 32768):
        for model in models:
            rates += [_rate(options, model, e, batch) for e in ENGINES[:4]]
            rates.append(_rate(options, model, "lanes last", batch, host_loops=True))
    rates += [_rate(options, "humanoid", e, 8192, iterations=1) for e in ENGINES[:4]]
    rates += [_rate(options, m, "lanes first", 8192) for m in models]
    for engine in ENGINES[:2]:
        rates.append(_rate(options, "gymnasium_humanoid", engine, 8192))
        rates.append(_rate(options, "humanoid", engine, 131072))
    gradients = [
        _row("gradient", "humanoid", e, 4096, repetitions=3) for e in ("lanes last", "MJX")
    ]
    learning = [
        _row("train", "half_cheetah", "ppo", note=note, set=[*words, "evaluations=1"])
        for note, words in (("4,096 environments", SCALE), ("as tuned", ["total_steps=1_000_000"]))
    ]
    first = [c for c in checks if c["model"] in ("humanoid", "hopper")]
    return first + rates[:8] + learning[:1] + gradients + rates[8:] + learning[1:] + checks[4:]


def _tiny_rows(options) -> list[dict]:
    """One of each kind."""
    options.steps = 3
    tiny = ["envs=8", "unroll=4", "minibatches=2", "passes=1", "total_steps=256", "evaluations=1"]
    tiny += ["evaluation_episodes=2", "policy.hidden=[4]", "value.hidden=[4]"]
    return [
        _row("check", "double_pendulum", "kernel"),
        _row("check", "double_pendulum", "lanes last"),
        _rate(options, "double_pendulum", "kernel", 8),
        _rate(options, "double_pendulum", "lanes last", 8),
        _rate(options, "double_pendulum", "mujoco_warp", 8),
        _row("gradient", "double_pendulum", "lanes last", 4, repetitions=1),
        _row("train", "fast", "ppo", set=tiny),
    ]


def _row(kind: str, model: str, engine: str, batch: int = 0, **more) -> dict:
    return {"kind": kind, "model": model, "engine": engine, "batch": batch, **more}


def _rate(options, model: str, engine: str, batch: int, **more) -> dict:
    settings = {"steps": options.steps, "repetitions": options.repetitions}
    if "host_loops" in more:
        settings["note"] = "loops outside command buffers"
    if "iterations" in more:
        settings["note"] = f"iterations={more['iterations']}"
    return _row("rate", model, engine, batch, **settings, **more)


def _environment(options, cache: str) -> dict[str, str]:
    environment = dict(os.environ)
    environment["JAX_COMPILATION_CACHE_DIR"] = cache
    environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    environment["XLA_PYTHON_CLIENT_PREALLOCATE"] = "false"
    if options.cpu:
        environment["JAX_PLATFORMS"] = "cpu"
    return environment


def _prepare(rows: list[dict], environment: dict, end: float) -> list[dict]:
    """Compiles all rows, as many at a time as there are pairs of cores, in their order."""
    workers = max(1, (os.cpu_count() or 2) // 2)
    # Half of the time at most: what is not compiled by then is compiled when its turn comes.
    until = time.monotonic() + (end - time.monotonic()) / 2
    prepare = lambda row: _work(row, environment, until, "--prepare")  # noqa: E731
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        return list(pool.map(prepare, rows))


def _run(row: dict, environment: dict, end: float) -> dict:
    if end - time.monotonic() < RESERVE:
        return {"why": "no time left"}
    return _work(row, environment, end)


def _work(row: dict, environment: dict, end: float, *words: str) -> dict:
    """What a worker finds, or why there is nothing."""
    command = [sys.executable, str(WORKER), json.dumps(row), *words]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment,
            timeout=max(1.0, end - time.monotonic()),
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {} if words else {"why": "took too long"}
    if done.returncode == 0:
        return json.loads(done.stdout.splitlines()[-1])
    said = [line for line in done.stderr.splitlines() if "Error" in line]
    return {"why": said[-1] if said else f"exit status {done.returncode}"}


if __name__ == "__main__":
    main()
