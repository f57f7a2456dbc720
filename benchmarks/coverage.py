"""How many of the world's MJCF files load, and whether what loads agrees with MuJoCo.

Every XML file below the given folders that MuJoCo compiles, and that has degrees of freedom, is
loaded in a process of its own with a time limit. With `--check N`, N of those that load, drawn by
a seed, are compared with MuJoCo C:

- `qacc`, sensors and the number of contacts at five states of a random motion, in float64 with both
  solvers converged: agreement to 1e-6, relative to the norm; the error in float32 stands beside it;
- contacts lost: states of four seconds of random motion for which there are too few slots.

A table of the reasons for refusals says how many files each stops, and how many it stops alone.
"""

import argparse
import collections
import json
import pathlib
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import common
import mujoco
import numpy as np
from rich.progress import track

STATES, SECONDS, SAMPLES = 5, 4.0, 200
QACC_TOLERANCE = 1e-6
QUICK = {"xla_backend_optimization_level": 0}


def main(arguments=None) -> None:
    options = _options(arguments)
    if options.worker:
        serve(options.x64)
        return
    files = sorted(f for folder in options.folders for f in folder.rglob("*.xml"))
    worker = Worker(options.limit)
    rows = [row for file in track(files, "loading") if (row := worker.examine(file, deep=False))]
    chosen = _chosen([r for r in rows if r["loads"]], options)
    for x64 in (True, False):
        worker = Worker(options.limit, x64)
        for row in track(chosen, "comparing"):
            row["float64" if x64 else "float32"] = worker.examine(row["file"], deep=True)
    record = {"summary": summary(rows), "reasons": reasons(rows), "rows": rows}
    print(common.table([record["summary"]]))
    if record["reasons"]:
        print(common.table(record["reasons"]))
    common.write(options, __file__, record)


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__ or "", repetitions=1)
    parser.add_argument("folders", nargs="*", type=pathlib.Path, help="where XML files are")
    parser.add_argument("--check", type=int, default=0, help="files that are compared with MuJoCo")
    parser.add_argument("--limit", type=float, default=120, help="seconds for one file")
    parser.add_argument("--seed", type=int, default=0, help="of the choice")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--x64", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args(arguments)


def _chosen(rows: list[dict], options) -> list[dict]:
    order = np.random.default_rng(options.seed).permutation(len(rows))
    return [rows[i] for i in order[: options.check]]


class Worker:
    """A process that examines one file after the other, and is replaced when one kills it."""

    def __init__(self, limit: float, x64: bool = False):
        """Start it when it is needed; a file may take `limit` seconds."""
        self._command = [sys.executable, __file__, "--worker", *(["--x64"] if x64 else [])]
        self._limit = limit
        self._process: subprocess.Popen | None = None

    def examine(self, file, deep: bool) -> dict | None:
        """What `examine` says; None where the file is no model with degrees of freedom."""
        process = self._process = self._process or self._start()
        assert process.stdin
        assert process.stdout
        alarm = threading.Timer(self._limit, process.kill)
        alarm.start()
        try:
            print(json.dumps([str(file), deep]), file=process.stdin, flush=True)
            answer = process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        hung = not alarm.is_alive()
        alarm.cancel()
        if answer:
            return json.loads(answer)
        self._process = None
        problem = f"hangs: more than {self._limit:g} s" if hung else "crash: the process died"
        return {"file": str(file), "loads": False, "problems": [problem]}

    def _start(self) -> subprocess.Popen:
        pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
        return subprocess.Popen(self._command, stdin=pipe, stdout=pipe, stderr=nothing, text=True)


def serve(x64: bool) -> None:
    """Answer the lines of the standard input; nothing else may print."""
    answers, sys.stdout = sys.stdout, sys.stderr
    common.setup(x64=x64)
    for line in sys.stdin:
        file, deep = json.loads(line)
        try:
            found = examine(file, x64, deep)
        except Exception as error:  # whatever a file may cause is a result
            problem = f"crash: {type(error).__name__}: {error}"
            found = {"file": file, "loads": False, "problems": [problem[:500]]}
        print(json.dumps(found, default=float), file=answers, flush=True)


def examine(file: str, x64: bool, deep: bool) -> dict | None:
    """Load one file, and compare it if asked to."""
    try:
        mj = mujoco.MjModel.from_xml_path(file)
    except ValueError:
        return None
    if not mj.nv:
        return None
    import jaxsim

    start = time.perf_counter()
    found = {"file": file, "nv": mj.nv, "ngeom": mj.ngeom}
    try:
        model = jaxsim.load(mj)
    except jaxsim.ModelError as error:
        return found | {"loads": False, "problems": list(error.problems)}
    found |= {"loads": True, "load s": time.perf_counter() - start}
    return found | (_compare(mj, model, x64) if deep else {})


def _compare(mj: mujoco.MjModel, model, x64: bool) -> dict:
    import jax

    import jaxsim

    mj.opt.iterations, mj.opt.ls_iterations, mj.opt.tolerance = 100, 50, 0
    if mj.opt.noslip_iterations:
        mj.opt.noslip_iterations, mj.opt.noslip_tolerance = 10_000, 0
    if x64:
        model = jaxsim.load(mj)
    visited = list(_motion(mj))
    every = visited[:: max(1, len(visited) // STATES)][:STATES]
    states, ctrls = _stacked(model, every)
    start = time.perf_counter()
    forward = jax.jit(jax.vmap(jaxsim.forward, (None, 0, 0)), compiler_options=QUICK)
    ours = forward(model, states, ctrls)
    ours = jax.device_get(ours)
    compile_s = time.perf_counter() - start
    theirs = [_forward(mj, data) for data, _ in every]
    errors = [_error(a, d.qacc) for a, d in zip(ours.qacc, theirs, strict=True)]
    active = [int(a.sum()) for a in ours.contact.active]
    sensors = [_error(a, d.sensordata) for a, d in zip(ours.sensordata, theirs, strict=True)]
    return {
        "qacc error": max(errors),
        "sensor error": max(sensors, default=0.0),
        "contacts": [active, [int(np.sum(d.contact.efc_address >= 0)) for d in theirs]],
        "lost": _lost(model, visited),
        "visited": len(visited),
        "first call s": compile_s,
    }


def _motion(mj: mujoco.MjModel) -> Iterator[tuple[mujoco.MjData, np.ndarray]]:
    """States of a random motion: controls that change every tenth of a second."""
    rng = np.random.default_rng(1)
    data = mujoco.MjData(mj)
    if mj.nkey:
        mujoco.mj_resetDataKeyframe(mj, data, 0)
    data.qvel[:] = 0.1 * rng.normal(size=mj.nv)
    limited = mj.actuator_ctrllimited.astype(bool)
    low = np.where(limited, mj.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, mj.actuator_ctrlrange[:, 1], 1.0)
    steps = int(SECONDS / mj.opt.timestep)
    hold = max(1, int(0.1 / mj.opt.timestep))
    for k in range(steps):
        if k % hold == 0:
            ctrl = rng.uniform(low, high)
        data.ctrl[:] = ctrl
        if k % max(1, steps // SAMPLES) == 0:
            here = mujoco.MjData(mj)
            here.qpos[:], here.qvel[:], here.act[:] = data.qpos, data.qvel, data.act
            here.ctrl[:], here.time = ctrl, data.time
            here.mocap_pos[:], here.mocap_quat[:] = data.mocap_pos, data.mocap_quat
            here.eq_active[:] = data.eq_active
            yield here, ctrl
        mujoco.mj_step(mj, data)


def _forward(mj: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    mujoco.mj_forward(mj, data)
    return data


def _stacked(model, visited):
    import jax.numpy as jnp

    import jaxsim

    put = lambda name: jnp.asarray(np.stack([getattr(d, name) for d, _ in visited]))  # noqa: E731
    state = jaxsim.make_state(model)
    names = "qpos", "qvel", "act", "mocap_pos", "mocap_quat"
    fields = {n: put(n).astype(getattr(state, n).dtype) for n in names}
    state = state.replace(**fields)
    count = len(visited)
    whole = {
        n: jnp.broadcast_to(v, (count, *v.shape))
        for n, v in vars(state).items()
        if n not in names and hasattr(v, "shape")
    }
    return state.replace(**whole), put("ctrl").astype(state.qpos.dtype)


def _lost(model, visited) -> int:
    """At how many states contacts found no slot."""
    import jax

    from jaxsim.dynamics.motion import motion_of
    from jaxsim.engine.stepping import contacts

    states, _ = _stacked(model, visited)
    lost = jax.vmap(lambda s: contacts(motion_of(model, s)).overflow)
    overflow = jax.jit(lost, compiler_options=QUICK)(states)
    return int((np.asarray(overflow) > 0).sum())


def _error(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference, relative to the norm where that is above one."""
    if not theirs.size:
        return 0.0
    return float(np.abs(ours - theirs).max() / max(1.0, np.linalg.norm(theirs)))


def summary(rows: list[dict]) -> dict:
    """What the run comes to, in one row."""
    checked = [r for r in rows if "float64" in r]
    deep = [r["float64"] for r in checked if "qacc error" in r["float64"]]
    agree = [d for d in deep if d["qacc error"] <= QACC_TOLERANCE]
    loads = sum(r["loads"] for r in rows)
    return {
        "models": len(rows),
        "load": loads,
        "per cent": 100 * loads / max(1, len(rows)),
        "crash or hang": sum(
            p.startswith(("crash", "hangs")) for r in rows for p in r.get("problems", ())
        ),
        "compared": len(checked),
        "agree": len(agree),
        "lose contacts": sum(d["lost"] > 0 for d in deep),
    }


def reasons(rows: list[dict]) -> list[dict]:
    """Why files are refused: how many each reason stops, and how many it stops alone."""
    stopped, alone = collections.Counter(), collections.Counter()
    for row in rows:
        kinds = {_kind(p) for p in row.get("problems", ())}
        stopped.update(kinds)
        if len(kinds) == 1:
            alone.update(kinds)
    return [{"reason": k, "files": n, "alone": alone[k]} for k, n in stopped.most_common()]


def _kind(problem: str) -> str:
    """A problem without the names of elements."""
    return re.sub(r"^.*?: ", "", re.sub(r'"[^"]*"|\'[^\']*\'|\d+', "_", problem))[:100]


if __name__ == "__main__":
    main()
