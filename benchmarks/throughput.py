"""Steps per second of whole batches: jaxsim beside MuJoCo C and MJX, in one process, interleaved.

All cores for everybody: jaxsim.batch_rollout with one XLA device per core, MJX with XLA's threads,
MuJoCo C by mujoco.rollout with one thread per core. Euler integrator, the models' other settings
as shipped, random controls, the first keyframe (or qpos0) with a little random velocity at the
start. MJX gets a batch of its own, `--mjx-batch`, at which it is fastest on a CPU. The peer `vmap`
is jaxsim's rollout under `jax.vmap`, with the batch first, on one device with XLA's threads: what
the other layout would give on the device at hand.

With `--envs`, environments as well: steps per second of the compiled step with automatic resets, of
the same behind Gymnasium's VectorEnv and Brax's interface, and of Gymnasium's own vectors.

Accuracy next to speed: the largest difference of accelerations to MuJoCo C, relative to the largest
acceleration, over states that a rollout of MuJoCo visits, from the same warm starts. Memory is
what the process grew by when the batch was compiled and run for the first time.
"""

import argparse
import dataclasses
import math
import os
import pathlib
import time
from collections.abc import Callable

import common
import environments
import models
import mujoco
import numpy as np

PEERS = ("jaxsim", "mujoco", "mjx", "vmap")


@dataclasses.dataclass
class Candidate:
    """A batch that can be run again and again.

    Attributes:
      run: all steps of all environments.
      steps: how many that are.
      compile_seconds: the first run less a later one.
      memory: growth of the process in the first run (MB).
      qacc: accelerations at the visited states; None for MuJoCo itself.
      iterations: mean number of solver steps there.
    """

    run: Callable[[], object]
    steps: int
    compile_seconds: float
    memory: float
    qacc: np.ndarray | None
    iterations: float | None


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup(devices=options.devices)
    rows = []
    for name in options.models:
        rows += _model_rows(name, options)
        print(common.table(r for r in rows if r["model"] == name), flush=True)
    env_rows = []
    for name in options.envs:
        env_rows += environments.rows(name, options)
        print(common.table(r for r in env_rows if r["environment"] == name), flush=True)
    if options.json:
        options.out, options.name = options.json.parent, options.json.stem
    common.write(
        options,
        __file__,
        {"rows": rows, "environments": env_rows},
        lambda figure: _draw(figure, rows, env_rows),
    )


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=5)
    fast = [name for name in models.MODELS if name not in ("gymnasium_humanoid", "five_humanoids")]
    models.add_models(parser, fast)
    parser.add_argument("--peers", type=_peers, default=["mujoco"], help="mujoco,mjx,vmap (mujoco)")
    parser.add_argument("--batch", type=int, default=1024, help="environments")
    parser.add_argument("--mjx-batch", type=int, default=128, help="environments for MJX")
    parser.add_argument("--steps", type=int, default=50, help="steps of a rollout")
    parser.add_argument(
        "--envs", nargs="*", default=[], choices=environments.GYMNASIUM, help="whole environments"
    )
    parser.add_argument("--env-steps", type=int, default=50, help="steps of an environment")
    parser.add_argument("--states", type=int, default=32, help="states for the accuracy")
    parser.add_argument("--devices", type=int, default=os.cpu_count(), help="devices and threads")
    parser.add_argument("--iterations", type=int, help="Newton steps (default: the model's)")
    parser.add_argument("--json", type=pathlib.Path, help="file to write instead of results/")
    return parser.parse_args(arguments)


def _peers(text: str) -> list[str]:
    """Names separated by commas."""
    names = [name for name in text.split(",") if name]
    for name in names:
        if name not in PEERS[1:]:
            raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(PEERS[1:])}")
    return names


def _model_rows(name: str, options) -> list[dict]:
    """One row for each peer; a row that says why where one has no result."""
    try:
        mj = models.load(name, options.menagerie)
    except (FileNotFoundError, ValueError) as error:
        return [{"model": name, "peer": "all", "why": str(error)}]
    if options.iterations:
        mj.opt.iterations = options.iterations
    states = models.visited(mj, options.states)
    build = {"jaxsim": _jaxsim, "mujoco": _mujoco, "mjx": _mjx, "vmap": _vmap}
    found, rows = {}, []
    for peer in ["jaxsim", *options.peers]:
        try:
            found[peer] = build[peer](mj, states, options)
        except (NotImplementedError, ValueError) as error:
            rows.append({"model": name, "peer": peer, "why": " ".join(str(error).split())})
    runs = {p: c.run for p, c in found.items()}
    times = common.interleave(runs, options.repetitions, clock=options.clock)
    baseline = times["mujoco"].per(found["mujoco"].steps).median if "mujoco" in found else None
    labels = {"model": name, "nv": mj.nv}
    return [labels | _row(p, c, times[p], states, baseline) for p, c in found.items()] + rows


def _row(peer: str, candidate: Candidate, timing, states, baseline: float | None) -> dict:
    per_step = timing.per(candidate.steps)
    row = {
        "peer": peer,
        "steps/s": 1 / per_step.median,
        "spread %": 100 * per_step.spread / per_step.median,
        "to MuJoCo": baseline / per_step.median if baseline else None,
        "compile s": candidate.compile_seconds,
        "memory MB": candidate.memory,
        "contacts": float(states.contacts.mean()),
        "iterations": candidate.iterations,
    }
    if candidate.qacc is not None:
        row |= models.acceleration_error(candidate.qacc, states.qacc)
    return row


def _jaxsim(mj, states, options) -> Candidate:
    import jaxsim

    return _ours(mj, states, options, jaxsim.vmap, jaxsim.batch_rollout)


def _vmap(mj, states, options) -> Candidate:
    import jax

    import jaxsim

    def rollout(model, state, ctrls):
        return jax.vmap(lambda s, u: jaxsim.rollout(model, s, u)[0])(state, ctrls)

    return _ours(mj, states, options, jax.vmap, jax.jit(rollout))


def _ours(mj, states, options, vmap, rollout) -> Candidate:
    import jax
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load(mj)
    qpos, qvel, act, ctrls = (jnp.asarray(x) for x in _start(mj, options.batch, options.steps))
    state = models.repeated(jaxsim.make_state(model), options.batch)
    state = state.replace(qpos=qpos, qvel=qvel, act=act)
    step = jax.jit(vmap(lambda s, u: jaxsim.step_with_status(model, s, u)))
    # A step by Euler's rule ends with the accelerations of its start as the next warm start.
    after, status = step(*states.batch(model, len(states.qpos)))

    def run():
        return jax.block_until_ready(rollout(model, state, ctrls))

    return Candidate(
        run,
        options.batch * options.steps,
        *_first_run(run),
        qacc=np.asarray(after.qacc_warmstart),
        iterations=float(status.iterations.mean()),
    )


def _mujoco(mj, states, options) -> Candidate:
    from mujoco import rollout

    qpos, qvel, act, ctrls = _start(mj, options.batch, options.steps)
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros((options.batch, mujoco.mj_stateSize(mj, spec)))
    data = mujoco.MjData(mj)
    for i in range(options.batch):
        data.qpos[:], data.qvel[:], data.act[:] = qpos[i], qvel[i], act[i]
        mujoco.mj_getState(mj, data, initial[i], spec)
    threads = rollout.Rollout(nthread=options.devices)
    datas = [mujoco.MjData(mj) for _ in range(options.devices)]

    def run():
        return threads.rollout(mj, datas, initial, ctrls)

    _, memory = _first_run(run)
    iterations = float(states.iterations.mean())
    return Candidate(run, options.batch * options.steps, 0.0, memory, None, iterations)


def _mjx(mj, states, options) -> Candidate:
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    model, data = mjx.put_model(mj), mjx.make_data(mj)

    def at(qpos, qvel, act):
        return data.replace(qpos=qpos, qvel=qvel, act=act)

    def rollout(qpos, qvel, act, ctrls):
        def body(d, ctrl):
            return mjx.step(model, d.replace(ctrl=ctrl)), None

        return jax.lax.scan(body, at(qpos, qvel, act), ctrls)[0].qpos

    def forward(qpos, qvel, act, warmstart, ctrl):
        given = at(qpos, qvel, act).replace(qacc_warmstart=warmstart, ctrl=ctrl)
        return mjx.forward(model, given).qacc

    # On one device with XLA's own threads: on several devices at a time it waits for ever.
    program = jax.jit(jax.vmap(rollout))
    args = [jnp.asarray(x) for x in _start(mj, options.mjx_batch, options.steps)]

    def run():
        return jax.block_until_ready(program(*args))

    first = _first_run(run)
    inputs = (states.qpos, states.qvel, states.act, states.warmstart, states.ctrl)

    qacc = np.asarray(jax.jit(jax.vmap(forward))(*(jnp.asarray(x) for x in inputs)))
    return Candidate(run, options.mjx_batch * options.steps, *first, qacc=qacc, iterations=None)


def _start(mj, batch: int, steps: int) -> tuple[np.ndarray, ...]:
    """qpos, qvel, act and controls of a batch, the same for all peers."""
    rng, data = np.random.default_rng(0), models.start(mj)
    rows = [np.tile(x, (batch, 1)) for x in (data.qpos, data.qvel, data.act)]
    rows[1] = rows[1] + 0.01 * rng.standard_normal(rows[1].shape)
    return *rows, models.controls(mj, rng, (batch, steps))


def _first_run(run) -> tuple[float, float]:
    """Seconds that the first run takes longer than the second, and growth of the process in MB."""
    before = _resident()
    start = time.perf_counter()
    run()
    first = time.perf_counter() - start
    grown = max(0.0, _resident() - before)
    start = time.perf_counter()
    run()
    return max(0.0, first - (time.perf_counter() - start)), grown


def _resident() -> float:
    import psutil

    return psutil.Process().memory_info().rss / 2**20


def _draw(figure, rows, env_rows) -> None:
    """Bars of steps per second: of models, of environments, or of both side by side."""
    timed = [r for r in rows if "steps/s" in r]
    panels = [(timed, "model", "peer", "steps/s")] if timed else []
    if env_rows:
        panels.append((env_rows, "environment", "by", "env steps/s"))
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        _bars(axes, *panel)


def _bars(axes, rows, what: str, by: str, rate: str) -> None:
    """One bar for each engine that was timed, with its rate; the axis starts at a power of ten."""
    names, engines = (list(dict.fromkeys(r[key] for r in rows)) for key in (what, by))
    width = 0.85 / len(engines)
    for i, engine in enumerate(engines):
        line = [r for r in rows if r[by] == engine]
        at = [names.index(r[what]) + width * (i - (len(engines) - 1) / 2) for r in line]
        bars = axes.bar(at, [r[rate] for r in line], width, label=engine)
        axes.bar_label(bars, fmt=_short, fontsize=6)
    low, high = (f(r[rate] for r in rows) for f in (min, max))
    axes.set_xticks(range(len(names)), names, fontsize=8)
    axes.set(yscale="log", ylabel=f"{rate.removesuffix('/s')} per second")
    axes.set_ylim(10 ** math.floor(math.log10(low) - 0.3), 2 * high)
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))


def _short(rate: float) -> str:
    """Three digits: 653k, 1.08M."""
    rate = float(f"{rate:.3g}")
    scale, unit = (1e6, "M") if rate >= 1e6 else (1e3, "k") if rate >= 1e3 else (1, "")
    return f"{rate / scale:g}{unit}"


if __name__ == "__main__":
    main()
