"""`jaxsim simulate`: many copies of one model on all devices, with a progress bar and a report."""

import argparse
import contextlib
import dataclasses
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import rich.console
import rich.progress
from jax.sharding import Mesh

import jaxsim
from jaxsim.cli import UsageError
from jaxsim.cli.report import note, report, working
from jaxsim.parallel.chunks import even_lanes, map_chunks
from jaxsim.parallel.devices import EVERYWHERE, SPLIT, dividing_mesh, parallel, shardings


@dataclasses.dataclass(frozen=True)
class Result:
    """The result of a simulation: the last states and the times in seconds."""

    states: jaxsim.State
    devices: int
    compile_time: float
    run_time: float
    diverged: int
    first_bad_step: int | None


def run(arguments: argparse.Namespace) -> int:
    """Load the model, simulate, report; returns the exit status."""
    prepare_cpu()
    model, state = _load(arguments)
    result = simulate(model, state, arguments)
    report(_rows(model, result, arguments))
    if result.diverged:
        note(_remedy(model, result, arguments))
    return int(result.diverged > 0)


def prepare_cpu() -> None:
    """Call `configure_cpu`, unless the calling program has already used JAX."""
    with contextlib.suppress(RuntimeError):
        jaxsim.configure_cpu()


def simulate(model: jaxsim.Model, state: jaxsim.State, arguments: argparse.Namespace) -> Result:
    """Simulate all environments in chunks of steps, and count those that diverge."""
    mesh = dividing_mesh(arguments.envs)
    advance = compiled_chunk(model, arguments.ctrl, mesh)
    states, keys = initial_states(state, arguments.envs, arguments.seed, mesh)
    start = time.perf_counter()
    with working("compiling"):
        states, keys, _ = jax.block_until_ready(advance(states, keys, 0))
    compile_time = time.perf_counter() - start

    done, diverged, first_bad_step = 0, 0, None
    start = time.perf_counter()
    with _progress() as progress:
        task = progress.add_task(f"{arguments.envs} x", total=arguments.steps, speed="")
        while done < arguments.steps:
            count = min(arguments.chunk, arguments.steps - done)
            states, keys, bad = advance(states, keys, count)
            done, diverged = done + count, int(bad.sum())
            if diverged and first_bad_step is None:
                first_bad_step = done
            speed = done * arguments.envs / (time.perf_counter() - start)
            progress.update(task, completed=done, speed=f"{speed:,.0f} steps/s")
    run_time = time.perf_counter() - start
    return Result(states, mesh.size, compile_time, run_time, diverged, first_bad_step)


def compiled_chunk(model: jaxsim.Model, ctrl: str, mesh: Mesh) -> Callable:
    """The function `(states, keys, count) -> (states, keys, diverged)`, over all devices.

    It takes `count` steps of every environment. The count is a traced argument, so that a shorter
    last chunk needs no second compilation, and a chunk of zero steps warms it up.
    """

    def advance(state, key, count):
        key, draw = jax.random.split(key)
        control = _control(model, ctrl, draw)
        state = jax.lax.fori_loop(0, count, lambda _, s: jaxsim.step(model, s, control), state)
        return state, key, ~(jnp.isfinite(state.qpos).all() & jnp.isfinite(state.qvel).all())

    def chunks(states, keys, count):
        run = jaxsim.vmap(lambda state, key: advance(state, key, count))
        return map_chunks(run, even_lanes(model, keys.shape[0]), states, keys)

    return parallel(chunks, mesh, (SPLIT, SPLIT, EVERYWHERE), SPLIT)


def _control(model, ctrl: str, key):
    if ctrl == "zero" or model.nu == 0:
        return jnp.zeros(model.nu, model.qpos0.dtype)
    limited = jnp.asarray(model.actuator_ctrllimited)
    low = jnp.where(limited, model.actuator_ctrlrange[:, 0], -1)
    high = jnp.where(limited, model.actuator_ctrlrange[:, 1], 1)
    return low + (high - low) * jax.random.uniform(key, (model.nu,), model.qpos0.dtype)


def _load(arguments: argparse.Namespace) -> tuple[jaxsim.Model, jaxsim.State]:
    try:
        model = jaxsim.load(arguments.model)
        state = jaxsim.make_state(model, arguments.keyframe)
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(error.args[0] if isinstance(error, KeyError) else error) from error
    if arguments.timestep:
        timestep = jnp.asarray(arguments.timestep, model.opt.timestep.dtype)
        model = model.replace(opt=model.opt.replace(timestep=timestep))
    return model, state


def initial_states(state: jaxsim.State, envs: int, seed: int, mesh: Mesh):
    """States and random keys of all environments; velocities differ, positions do not."""

    def one(key):
        velocity, control = jax.random.split(key)
        noise = 0.01 * jax.random.normal(velocity, state.qvel.shape, state.qvel.dtype)
        return state.replace(qvel=state.qvel + noise), control

    keys = jax.random.split(jax.random.key(seed), envs)
    return jax.jit(jax.vmap(one), out_shardings=shardings(mesh, SPLIT))(keys)


def _progress() -> rich.progress.Progress:
    return rich.progress.Progress(
        rich.progress.TextColumn("{task.description}"),
        rich.progress.MofNCompleteColumn(),
        rich.progress.BarColumn(),
        rich.progress.TextColumn("{task.fields[speed]}"),
        rich.progress.TimeRemainingColumn(),
        console=rich.console.Console(stderr=True),
    )


def _rows(model, result: Result, arguments: argparse.Namespace) -> dict[str, str]:
    total = arguments.envs * arguments.steps
    speed = total / result.run_time
    sizes = f"nq {model.nq}, nv {model.nv}, nu {model.nu}"
    platform = jax.default_backend()
    return {
        "model": f"{arguments.model} ({sizes})",
        "environments": f"{arguments.envs:,} on {result.devices} {platform} device(s)",
        "steps each": f"{arguments.steps:,} of {float(model.opt.timestep):g} s",
        "compile time": f"{result.compile_time:.1f} s",
        "run time": f"{result.run_time:.2f} s",
        "steps per second": f"{speed:,.0f}",
        "simulated per second": f"{speed * float(model.opt.timestep):,.0f} s",
        "mean kinetic energy": f"{_kinetic_energy(model, result.states):.4g} J",
        "diverged environments": f"{result.diverged:,}",
    }


def _kinetic_energy(model, states: jaxsim.State) -> float:
    """Mean over the environments that did not diverge."""

    def one(state):
        mass = jaxsim.mass_matrix(model, state.qpos)
        return 0.5 * state.qvel @ (mass @ state.qvel)

    return float(jnp.nanmean(jax.jit(jax.vmap(one))(states)))


def _remedy(model, result: Result, arguments: argparse.Namespace) -> str:
    half = float(model.opt.timestep) / 2
    return (
        f"{result.diverged} of {arguments.envs} environments diverged, the first before step "
        f"{result.first_bad_step}: try a shorter time step (--timestep {half:g}), smaller controls "
        "(--ctrl zero), or more joint damping or armature in the model."
    )
