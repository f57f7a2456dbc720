"""`jaxsim inspect`: what a model has, what is refused and why, and what it costs."""

import argparse
import time

import jax
import mujoco
import numpy as np

import jaxsim
from jaxsim.cli import UsageError
from jaxsim.cli.report import listing, note, report, working
from jaxsim.cli.simulate import compiled_chunk, initial_states, prepare_cpu
from jaxsim.collision import Candidates, model_candidates
from jaxsim.io.loading import compile_mujoco
from jaxsim.parallel.devices import dividing_mesh

STEPS = 50


def run(arguments: argparse.Namespace) -> int:
    """Load and report; 1 if the model is refused."""
    prepare_cpu()
    mj = _compiled(arguments.model)
    rows = {"model": arguments.model} | _contents(mj)
    start = time.perf_counter()
    try:
        model = jaxsim.load(mj, unsupported_pairs="drop" if arguments.drop_pairs else "error")
    except jaxsim.ModelError as error:
        report(rows)
        note("refused:")
        for problem in error.problems:
            note(f"- {problem}")
        return 1
    rows["load time"] = f"{time.perf_counter() - start:.1f} s"
    rows |= _sizes(model)
    if arguments.speed:
        with working("compiling, and simulating"):
            rows |= _speeds(mj, model, arguments)
    report(rows)
    candidates = model_candidates(model)
    if candidates.groups:
        listing("geom pairs", ("candidates", "evaluated", "contacts"), "", _pairs(candidates))
    return 0


def _compiled(source: str) -> mujoco.MjModel:
    try:
        return compile_mujoco(source)
    except (OSError, ValueError) as error:
        raise UsageError(error) from error


def _contents(mj: mujoco.MjModel) -> dict[str, str]:
    """How many of each element MuJoCo's compiler has found."""
    elements = "body jnt geom site mesh hfield tendon eq sensor key".split()
    counts = {name: getattr(mj, f"n{name}") for name in elements}
    counts["body"] -= 1  # the world
    names = {"jnt": "joint", "eq": "equality", "key": "keyframe"}
    integrator = mujoco.mjtIntegrator(mj.opt.integrator).name.removeprefix("mjINT_").lower()
    cone = mujoco.mjtCone(mj.opt.cone).name.removeprefix("mjCONE_").lower()
    return {
        "sizes": f"nq {mj.nq}, nv {mj.nv}, nu {mj.nu}, na {mj.na}",
        "elements": ", ".join(f"{n} {names.get(k, k)}" for k, n in counts.items() if n),
        "options": f"{integrator}, {cone}, {mj.opt.timestep:g} s",
    }


def _sizes(model: jaxsim.Model) -> dict[str, str]:
    """Budgets of contacts, hulls, and memory of a state."""
    slots = [
        f"{r.stop - r.start} of condim {r.condim} {'of two bodies' if all(r.kind.movable) else ''}"
        for r in model_candidates(model).ranges
    ]
    corners = model.hull_size[:, 0]
    hulls = f"{len(corners)}, of at most {corners.max()} corners" if len(corners) else "none"
    state = sum(x.nbytes for x in jax.tree.leaves(jaxsim.make_state(model)))
    return {
        "contact slots": ", ".join(map(str.strip, slots)) or "none",
        "convex hulls": hulls,
        "state": f"{state:,} bytes an environment",
    }


def _pairs(candidates: Candidates):
    """One row for each group of candidates: shapes, pairs, those evaluated, contacts of each."""
    for group, evaluated in zip(candidates.groups, candidates.pairs(), strict=True):
        names = (mujoco.mjtGeom(t).name.removeprefix("mjGEOM_").lower() for t in group.types)
        yield "-".join(names), len(group), evaluated, f"up to {group.slots_per_pair} each", ""


def _speeds(mj: mujoco.MjModel, model: jaxsim.Model, arguments) -> dict[str, str]:
    """Compilation, memory and speed of a batch under random controls, beside MuJoCo C."""
    mesh = dividing_mesh(arguments.envs)
    states, keys = initial_states(jaxsim.make_state(model), arguments.envs, 0, mesh)
    start = time.perf_counter()
    program = compiled_chunk(model, "random", mesh).lower(states, keys, 0).compile()
    compiled = time.perf_counter() - start
    jax.block_until_ready(program(states, keys, 1))
    start = time.perf_counter()
    jax.block_until_ready(program(states, keys, STEPS))
    ours = arguments.envs * STEPS / (time.perf_counter() - start)
    memory = program.memory_analysis().temp_size_in_bytes * mesh.size / arguments.envs
    theirs = _mujoco_speed(mj, mesh.size)
    return {
        "compile time": f"{compiled:.1f} s",
        "memory of a step": f"{memory:,.0f} bytes an environment",
        "steps per second": f"{ours:,.0f} ({arguments.envs:,} environments, {mesh.size} devices)",
        "of MuJoCo C": f"{theirs:,.0f} ({mesh.size} threads)",
    }


def _mujoco_speed(mj: mujoco.MjModel, threads: int) -> float:
    """Steps per second of `mujoco.rollout` under random controls."""
    from mujoco import rollout

    rng, count = np.random.default_rng(0), 8 * threads
    limited = mj.actuator_ctrllimited.astype(bool)[:, None]
    low, high = np.where(limited, mj.actuator_ctrlrange, [[-1.0, 1.0]]).T
    ctrls = rng.uniform(low, high, (count, STEPS, mj.nu))
    initial = np.zeros((count, mujoco.mj_stateSize(mj, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    data = mujoco.MjData(mj)
    for row in initial:
        data.qvel[:] = 0.01 * rng.normal(size=mj.nv)
        mujoco.mj_getState(mj, data, row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with rollout.Rollout(nthread=threads) as pool:
        datas = [mujoco.MjData(mj) for _ in range(threads)]
        pool.rollout(mj, datas, initial, ctrls)
        start = time.perf_counter()
        pool.rollout(mj, datas, initial, ctrls)
        return count * STEPS / (time.perf_counter() - start)
