"""The constraint problem: time, iterations and error of the three ways to solve with its Hessian.

At states that a rollout of MuJoCo visits, and from the same warm starts. What is timed: rows are
assembled from known kinematics and contacts, then the problem is solved to the model's tolerance
in at most `--iterations` steps. For MuJoCo C that is mj_makeConstraint, mj_referenceConstraint and
mj_fwdConstraint, called from Python on one thread; the cost of the calls is measured on an empty
model and subtracted. jaxsim runs `--batch` environments on one thread, in the chunks of a rollout;
each takes as many Newton steps as its slowest environment, and its time contains the layout of the
operands, which in a step come as they are needed. MJX, if asked for, runs its mjx.forward minus the
same with constraints disabled.

A second table follows chains of links that lie on a plane: one Newton step each.
"""

import argparse

import common
import models
import mujoco
import numpy as np

STRATEGIES = ("articulated", "dense", "iterative")


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup(x64=options.x64)
    rows = []
    for name in options.models:
        rows += _model_rows(name, options)
        print(common.table(r for r in rows if r["model"] == name), flush=True)
    chains = [row for n in options.chains for row in _chain_rows(n, options)]
    if chains:
        print(common.table(chains))
    record = {"rows": rows, "chains": chains}
    common.write(options, __file__, record, lambda figure: _draw(figure, rows, chains))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=9)
    small = [name for name in models.MODELS if name != "five_humanoids"]
    parser.add_argument("--models", nargs="*", default=small, choices=models.MODELS)
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES), choices=STRATEGIES)
    parser.add_argument("--chains", type=int, nargs="*", default=[8, 16, 32, 64, 128, 256])
    parser.add_argument("--batch", type=int, default=128, help="environments")
    parser.add_argument("--states", type=int, default=32, help="different states in the batch")
    parser.add_argument("--iterations", type=int, default=100, help="Newton steps at most")
    parser.add_argument("--peers", nargs="*", default=[], choices=["mjx"], help="besides MuJoCo C")
    parser.add_argument("--x64", action="store_true", help="float64")
    return parser.parse_args(arguments)


def _model_rows(name: str, options) -> list[dict]:
    """One row for each strategy and peer; a row that says why where there is no result."""
    import jaxsim

    try:
        mj = models.load(name)
        mj.opt.iterations, mj.opt.ls_iterations = options.iterations, 50
        model = jaxsim.load(mj)
    except (jaxsim.ModelError, FileNotFoundError, ValueError) as error:
        return [{"model": name, "solver": "none", "why": str(error)}]
    states = models.visited(mj, options.states)
    return _rows({"model": name, "nv": mj.nv}, mj, model, states, options)


def _chain_rows(n: int, options) -> list[dict]:
    import jaxsim

    mj = touching_chain(n)
    mj.opt.iterations = 1
    strategies = ["articulated"] + ["dense"] * (n <= 64)
    options = argparse.Namespace(**{**vars(options), "strategies": strategies, "peers": []})
    states = models.at_start(mj, options.states)
    return _rows({"links": n}, mj, jaxsim.load(mj, hessian="articulated"), states, options)


def touching_chain(n: int) -> mujoco.MjModel:
    """A chain that lies on a plane; all of its links touch the plane and nothing else."""
    spec = mujoco.MjSpec()
    size = [0.0, 0.0, 1.0]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=size, contype=0, conaffinity=1)
    body = spec.worldbody
    for i in range(n):
        body = body.add_body(pos=[0.1, 0, 0] if i else [0, 0, 0.049])
        axis = [0, 1, 0] if i % 2 == 0 else [0, 0, 1]
        body.add_joint(axis=axis, armature=0.1, damping=1.0)
        body.add_geom(size=[0.05, 0, 0], pos=[0.05, 0, 0], mass=0.1, contype=1, conaffinity=0)
    return spec.compile()


def _rows(labels: dict, mj, model, states, options) -> list[dict]:
    """Interleaved times of all strategies and of MuJoCo."""
    import jaxsim

    programs, failed = {}, []
    for strategy in options.strategies:
        try:
            programs[strategy] = _program(model.replace(hessian=strategy), states, options.batch)
        except jaxsim.ModelError as error:
            failed.append({**labels, "solver": strategy, "why": " ".join(str(error).split())})
    candidates = {name: run for name, (run, _) in programs.items()}
    mujoco_all, calls_all = _mujoco_candidates(mj, states)
    candidates |= {"MuJoCo C": mujoco_all, "calls": calls_all}
    times = common.interleave(candidates, options.repetitions, clock=options.clock)
    rows = [
        labels | _row(name, times[name].per(options.batch), states, run, seconds)
        for name, (run, seconds) in programs.items()
    ]
    peers = [labels | _mujoco_row(times, states), *_peer_rows(labels, mj, states, options)]
    return rows + peers + failed


def _row(name: str, time: common.Timing, states, run, compile_seconds: float) -> dict:
    qacc, iterations = (np.asarray(x)[: len(states.qacc)] for x in run())
    return {
        "solver": name,
        "us": time.median * 1e6,
        "spread": time.spread * 1e6,
        "best": time.best * 1e6,
        "iterations": float(iterations.mean()),
        "most": int(iterations.max()),
        "contacts": float(states.contacts.mean()),
        "compile s": compile_seconds,
        **models.acceleration_error(qacc, states.qacc[: len(qacc)]),
    }


def _mujoco_row(times, states) -> dict:
    seconds = (times["MuJoCo C"].median - times["calls"].median) / len(states.qpos)
    return {
        "solver": "MuJoCo C",
        "us": seconds * 1e6,
        "iterations": float(states.iterations.mean()),
        "most": int(states.iterations.max()),
        "contacts": float(states.contacts.mean()),
    }


def _program(model, states, batch: int):
    """The batch of constraint problems, given everything before them; seconds to compile."""
    import jax

    import jaxsim
    from jaxsim.constraint import constrained_acceleration
    from jaxsim.dynamics.motion import Motion
    from jaxsim.engine.stepping import evaluate
    from jaxsim.parallel.chunks import even_lanes

    shape = {}

    def before(state, ctrl):
        now = evaluate(model, state, ctrl)  # its solve is not used, and so not computed
        shape["contact"], numbers = _split_static(now.constrained.contact)
        return now.motion.kin, now.motion.vel, numbers, now.qfrc_smooth

    def constrained(state, kin, vel, numbers, qfrc_smooth):
        motion, contact = Motion(model, state.qpos, state.qvel, kin, vel), shape["contact"](numbers)
        found = constrained_acceleration(motion, contact, qfrc_smooth, state.qacc_warmstart)
        return found.qacc, found.status.iterations

    state, ctrl = states.batch(model, batch)
    given = jax.jit(jaxsim.vmap(before))(state, ctrl)
    chunked = common.in_chunks(constrained, even_lanes(model, batch))
    run, _, seconds = common.compile_for(chunked, state, *given)
    return run, seconds


def _split_static(record):
    """Its traced leaves, and a function from these to the record: numpy leaves stay numpy."""
    import jax

    leaves, tree = jax.tree.flatten(record)
    fixed = [isinstance(x, np.ndarray) for x in leaves]

    def join(numbers):
        rest = iter(numbers)
        return jax.tree.unflatten(
            tree, [x if is_fixed else next(rest) for x, is_fixed in zip(leaves, fixed, strict=True)]
        )

    return join, [x for x, is_fixed in zip(leaves, fixed, strict=True) if not is_fixed]


def _mujoco_candidates(mj, states):
    """The stages of MuJoCo at all states, and what calling them costs."""
    datas = [_data_at(mj, states, i) for i in range(len(states.qpos))]
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    nothing = mujoco.MjData(empty)
    elsewhere = np.zeros(mj.nv)

    def stages(model, data):
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_referenceConstraint(model, data)
        mujoco.mj_fwdConstraint(model, data)

    def run():
        for data, warmstart in zip(datas, states.warmstart, strict=True):
            data.qacc_warmstart[:] = warmstart
            stages(mj, data)

    def calls():
        for warmstart in states.warmstart:
            elsewhere[:] = warmstart
            stages(empty, nothing)

    return run, calls


def _data_at(mj, states, i: int) -> mujoco.MjData:
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.act[:] = states.qpos[i], states.qvel[i], states.act[i]
    data.ctrl[:], data.qacc_warmstart[:] = states.ctrl[i], states.warmstart[i]
    mujoco.mj_forward(mj, data)
    return data


def _peer_rows(labels: dict, mj, states, options) -> list[dict]:
    """MJX: forward, minus forward without constraints."""
    if "mjx" not in options.peers:
        return []
    try:
        programs = {w: _mjx_program(mj, states, options.batch, w) for w in ("full", "free")}
    except (NotImplementedError, ValueError) as error:
        return [{**labels, "solver": "MJX", "why": " ".join(str(error).split())}]
    candidates = {name: run for name, (run, _) in programs.items()}
    times = common.interleave(candidates, options.repetitions, clock=options.clock)
    row = {
        "solver": "MJX",
        "us": (times["full"].median - times["free"].median) / options.batch * 1e6,
        "compile s": programs["full"][1],
    }
    qacc = np.asarray(programs["full"][0]())[: len(states.qacc)]
    return [labels | row | models.acceleration_error(qacc, states.qacc[: len(qacc)])]


def _mjx_program(mj, states, batch: int, which: str):
    import copy

    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    mj = copy.copy(mj)
    if which == "free":
        mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model, data = mjx.put_model(mj), mjx.make_data(mj)
    index = np.arange(batch) % len(states.qpos)

    def forward(qpos, qvel, act, warmstart, ctrl):
        given = data.replace(qpos=qpos, qvel=qvel, act=act, qacc_warmstart=warmstart, ctrl=ctrl)
        return mjx.forward(model, given).qacc

    inputs = (states.qpos, states.qvel, states.act, states.warmstart, states.ctrl)
    args = [jnp.asarray(x[index], jnp.result_type(float)) for x in inputs]
    run, _, seconds = common.compile_for(jax.vmap(forward), *args)
    return run, seconds


def _draw(figure, rows, chains) -> None:
    """Bars for the models, lines for the chains."""
    left, right = figure.subplots(1, 2)
    timed = [r for r in rows if "us" in r]
    names = list(dict.fromkeys(r["model"] for r in timed))
    solvers = list(dict.fromkeys(r["solver"] for r in timed))
    for i, solver in enumerate(solvers):
        found = {r["model"]: r["us"] for r in timed if r["solver"] == solver}
        at = [names.index(name) + 0.8 * i / len(solvers) for name in found]
        left.bar(at, list(found.values()), 0.8 / len(solvers), label=solver)
    left.set_xticks(range(len(names)), names, rotation=60, fontsize=7)
    left.set(yscale="log", ylabel="us per environment", title="constraint problem, one thread")
    if timed:  # room for the legend above the highest bar
        left.set_ylim(top=30 * max(r["us"] for r in timed))
    for solver in dict.fromkeys(r["solver"] for r in chains):
        line = [r for r in chains if r["solver"] == solver and "us" in r]
        right.loglog([r["links"] for r in line], [r["us"] for r in line], "o-", label=solver)
    right.set(xlabel="links that lie on a plane", title="one Newton step")
    for axes in (left, right):
        if axes.has_data():
            axes.legend(fontsize=7, loc="upper left", ncols=2)
        else:
            axes.remove()


if __name__ == "__main__":
    main()
