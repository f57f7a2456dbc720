"""How many of the world's MJCF files load, and whether what loads agrees with MuJoCo.

Every XML file below the given folders that MuJoCo compiles, and that has degrees of freedom, is
loaded in a process of its own with a time limit. With `--check N`, N of those that load, drawn by
a seed, are compared with MuJoCo C in float64, and with `--check32 M` the first M also in float32:

- `qacc` and sensors at five states of a random motion, with both solvers and MuJoCo's search for
  contacts of convex shapes converged: agreement to 1e-6 in float64 and 1e-2 in float32, relative
  to the norm;
- contacts lost: states of four seconds of random motion for which there are too few slots, of
  those for which there is time.

A state is left out, and counted as undecided, if the difference is at most twice that between
MuJoCo's own answers there and with joints and geoms moved by about 1e-9 (1e-6 for float32, to which
a state is rounded): a contact that touches by 1e-12, say, exists for the one and not for the other.

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
# After so many seconds, no further state is tried for lost contacts.
LATEST = 20.0
# By precision: the largest error that counts as agreement, and the noise to which an answer must be
# robust to count at all. It is drawn NOISES times for a state.
TOLERANCE = {"float64": 1e-6, "float32": 1e-2}
NOISE, NOISES = {"float64": 1e-9, "float32": 1e-6}, 24
# Levels of optimisation of programs that run a few hundred times, without and with hulls.
QUICK, QUICK_FOR_HULLS = 0, 1


def main(arguments=None) -> None:
    options = _options(arguments)
    if options.worker:
        serve(options.x64)
        return
    rows = _earlier(options) if options.resume else []
    known = {row["file"] for row in rows}
    files = sorted(f for folder in options.folders for f in folder.rglob("*.xml"))
    files = [f for f in files if str(f) not in known]
    worker = Worker(options.limit)
    rows += [r for file in track(files, "loading") if (r := worker.examine(file, deep=False))]
    end = time.monotonic() + 60 * options.minutes
    chosen = _chosen([r for r in rows if r["loads"]], options)
    for precision, some in (("float32", chosen[: options.check32]), ("float64", chosen)):
        worker = Worker(options.limit, precision == "float64")
        for row in track([r for r in some if precision not in r], "comparing"):
            if time.monotonic() < end:
                found = worker.examine(row["file"], deep=True) or {}
                row[precision] = found | {"agrees": _agrees(found, TOLERANCE[precision])}
                _write(options, rows)
    record = _write(options, rows)
    print(common.table([record["summary"]]))
    if record["reasons"]:
        print(common.table(record["reasons"]))


def _earlier(options) -> list[dict]:
    """Rows of the file that an earlier run has written."""
    file = options.out / f"{options.name or 'coverage'}.json"
    return json.loads(file.read_text())["rows"]


def _write(options, rows: list[dict]) -> dict:
    record = {"summary": summary(rows), "reasons": reasons(rows), "rows": rows}
    common.write(options, __file__, record)
    return record


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__ or "", repetitions=1)
    parser.add_argument("folders", nargs="*", type=pathlib.Path, help="where XML files are")
    parser.add_argument("--check", type=int, default=0, help="files that are compared with MuJoCo")
    parser.add_argument("--check32", type=int, default=0, help="files also compared in float32")
    parser.add_argument("--resume", action="store_true", help="keep what an earlier run found")
    parser.add_argument(
        "--minutes", type=float, default=np.inf, help="after these, no comparison begins"
    )
    parser.add_argument("--limit", type=float, default=120, help="seconds for one file")
    parser.add_argument("--seed", type=int, default=0, help="of the choice")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--x64", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args(arguments)


def _chosen(rows: list[dict], options) -> list[dict]:
    """Rows drawn by the seed, the model of every folder that loads first, then the second, ..."""
    order = np.random.default_rng(options.seed).permutation(len(rows))
    drawn = sorted((rows[i] for i in order[: options.check]), key=lambda r: r["load s"])
    folders: collections.Counter[str] = collections.Counter()
    ranks = {}
    for row in drawn:
        folder = pathlib.Path(row["file"]).parts[0]
        ranks[row["file"]] = folders[folder]
        folders[folder] += 1
    return sorted(drawn, key=lambda r: ranks[r["file"]])


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
    import jax

    answers, sys.stdout = sys.stdout, sys.stderr
    common.setup(x64=x64)
    for line in sys.stdin:
        file, deep = json.loads(line)
        jax.clear_caches()
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
    return found | (_compare(mj, model, "float64" if x64 else "float32") if deep else {})


def _compare(mj: mujoco.MjModel, model, precision: str) -> dict:
    import jax

    import jaxsim

    # The motion has the model's own settings, because those for a converged answer take minutes.
    visited = list(_motion(mj))
    model = _converged(mj, model)

    def answer(state, ctrl):
        found = jaxsim.forward(model, state, ctrl)
        count = found.contact.active.sum()
        return found.qacc, found.sensordata, count, found.status.contact_overflow

    states, ctrls = _stacked(model, visited)
    start = time.perf_counter()
    quick = common.quick_options(QUICK_FOR_HULLS if len(model.hull_size) else QUICK)
    # One environment at a time: it is compiled sooner than a batch, and for all states.
    program = jax.jit(answer, compiler_options=quick).lower(*_row((states, ctrls), 0)).compile()
    compile_s = time.perf_counter() - start
    judged = range(0, len(visited), max(1, len(visited) // STATES))[:STATES]
    others = np.random.default_rng(0).permutation(np.setdiff1d(np.arange(len(visited)), judged))
    ours, end = {}, time.perf_counter() + LATEST
    for k in [*judged, *others]:
        if k in judged or time.perf_counter() < end:
            ours[k] = jax.device_get(program(*_row((states, ctrls), int(k))))
    errors, contacts = [], []
    for k in judged:
        theirs = _forward(mj, visited[k][0])
        error = _errors(ours[k], theirs)
        contacts.append([int(ours[k][2]), int(np.sum(theirs.contact.efc_address >= 0))])
        if error.max() <= TOLERANCE[precision] or _decided(mj, theirs, error, NOISE[precision]):
            errors.append(error)
    qacc, sensors = np.max(errors, axis=0) if errors else (None, None)
    return {
        "qacc error": qacc,
        "sensor error": sensors,
        "undecided": len(judged) - len(errors),
        "contacts": contacts,
        "lost": sum(int(overflow) > 0 for *_, overflow in ours.values()),
        "visited": len(ours),
        "compile s": compile_s,
    }


def _converged(mj: mujoco.MjModel, model):
    """The model with settings for a converged answer; those of `mj` are changed to the same."""
    settings = {"iterations": 100, "ls_iterations": 50}
    if mj.opt.noslip_iterations:
        settings["noslip_iterations"] = 10_000
    for name, value in settings.items():
        setattr(mj.opt, name, value)
    common.converge(mj)
    return model.replace(opt=model.opt.replace(tolerance=0 * model.opt.tolerance, **settings))


def _row(tree, k: int):
    import jax

    return jax.tree.map(lambda x: x[k], tree)


def _errors(ours, theirs: mujoco.MjData) -> np.ndarray:
    return np.array([_error(ours[0], theirs.qacc), _error(ours[1], theirs.sensordata)])


def _decided(mj: mujoco.MjModel, data: mujoco.MjData, errors: np.ndarray, noise: float) -> bool:
    """Whether the errors are larger than the differences of MuJoCo's answers near the state."""
    rng, largest = np.random.default_rng(0), np.zeros(2)
    near, exact, same = mujoco.MjData(mj), mj.geom_pos.copy(), mj.geom_sameframe.copy()
    mj.geom_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE  # or it would not read positions
    for _ in range(NOISES):
        # Shapes that turn on each other touch by rounding, whatever the joints' angles.
        mj.geom_pos[:] = exact + noise * rng.normal(size=exact.shape)
        mujoco.mj_copyData(near, mj, data)
        mujoco.mj_integratePos(mj, near.qpos, noise * rng.normal(size=mj.nv), 1)
        mujoco.mj_forward(mj, near)
        largest = np.maximum(largest, _errors((near.qacc, near.sensordata), data))
    mj.geom_pos[:], mj.geom_sameframe[:] = exact, same
    return not np.all(errors <= 2 * largest)  # true for NaN, too


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
    from jaxsim.model.history import history_of

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
    if model.nhistory:
        past = [history_of(model, d.history, d.time) for d, _ in visited]
        whole |= {"history": jnp.stack(past)}
    return state.replace(**whole), put("ctrl").astype(state.qpos.dtype)


def _error(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference, relative to the norm where that is above one."""
    if not theirs.size:
        return 0.0
    return float(np.abs(ours - theirs).max() / max(1.0, np.linalg.norm(theirs)))


def summary(rows: list[dict]) -> dict:
    """What the run comes to, in one row."""
    counts: dict[str, int] = {}
    for precision in TOLERANCE:
        found = [r[precision] for r in rows if precision in r]
        undecided = sum(d.get("undecided") == STATES for d in found)
        counts |= {
            f"compared in {precision}": len(found),
            f"undecided in {precision}": undecided,
            f"agree in {precision}": sum(d["agrees"] for d in found),
        }
    deep = [r["float64"] for r in rows if "lost" in r.get("float64", ())]
    loads = sum(r["loads"] for r in rows)
    return {
        "models": len(rows),
        "load": loads,
        "per cent": 100 * loads / max(1, len(rows)),
        "crash or hang": sum(
            p.startswith(("crash", "hangs")) for r in rows for p in r.get("problems", ())
        ),
        **counts,
        "lose contacts": sum(d["lost"] > 0 for d in deep),
    }


def _agrees(found: dict, tolerance: float) -> bool:
    errors = [found.get(f"{what} error") for what in ("qacc", "sensor")]
    return all(e is not None and e <= tolerance for e in errors)


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
