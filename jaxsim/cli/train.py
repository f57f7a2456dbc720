"""`jaxsim train`: train a policy, with logs, checkpoints, a learning curve and a video."""

import argparse
import contextlib
import datetime
import pathlib
import shlex

from jaxsim import rl
from jaxsim.cli import UsageError
from jaxsim.cli.episode import save_video
from jaxsim.cli.report import note, report
from jaxsim.cli.simulate import prepare_cpu
from jaxsim.cli.watch import Watch
from jaxsim.rl.driver import Result, make_env, run_env
from jaxsim.rl.errors import CheckpointError
from jaxsim.rl.metrics import read
from jaxsim.rl.parts import distributed
from jaxsim.rl.runs.directory import read_run
from jaxsim.rl.runs.stored import stored_settings
from jaxsim.viz.plots.learning import plot_learning


def run(arguments: argparse.Namespace) -> int:
    """Train, draw, report; returns the exit status."""
    if arguments.processes > 1:
        distributed.join(arguments.coordinator, arguments.processes, arguments.process)
    else:
        prepare_cpu()
    try:
        watch = _watch(arguments)
        with contextlib.closing(watch) if watch else contextlib.nullcontext():
            result = _train(arguments, watch)
    except (rl.ConfigError, CheckpointError) as error:
        raise UsageError(error) from error
    if distributed.is_main():
        _finish(arguments, result)
    return 130 if result.interrupted else 0


def _train(arguments: argparse.Namespace, watch: Watch | None) -> Result:
    algorithm, seed = arguments.algorithm or "ppo", arguments.seed
    directory, settings = arguments.out, arguments.config
    if arguments.resume:
        stored = read_run(arguments.resume)
        directory, settings = arguments.resume, stored_settings(stored, arguments.algorithm)[1]
        algorithm, seed = stored["algorithm"], stored["seed"]
    return rl.train(
        arguments.env,
        algorithm,
        settings,
        overrides=arguments.set,
        seed=seed,
        directory=directory or _directory(arguments.env, algorithm),
        resume=arguments.resume is not None,
        progress=True,
        watch=watch,
    )


def _watch(arguments: argparse.Namespace) -> Watch | None:
    """The live page of the current policy, if requested."""
    if not (arguments.watch and distributed.is_main()):
        return None
    return Watch(make_env(arguments.env, rl.resolve(arguments.env, arguments.algorithm or "ppo")))


def _finish(arguments: argparse.Namespace, result: Result) -> None:
    """Write the learning curve and the video, and print the report."""
    assert result.directory is not None
    if result.finished:
        note(
            f"the run in {result.directory} has come to its end, and nothing was changed; "
            "--set total_steps=N makes it longer, --set target=null goes on past its target"
        )
        return
    notes = [_curve(arguments.env, result.directory)]
    if arguments.video and not result.interrupted:
        env = run_env(read_run(result.directory), arguments.env, arguments.algorithm)
        notes.append(save_video(env, result.policy, result.directory / "episode", arguments.seed))
    report(_rows(result, _next(arguments, result)))
    for text in notes:
        note(text)


def _curve(name: str, directory: pathlib.Path) -> str:
    path = directory / "curve.png"
    try:
        plot_learning({"deterministic policy": read(directory / "metrics.jsonl")}, path, name)
    except RuntimeError as error:
        return f"no learning curve: {error}"
    return f"learning curve: {path}"


def _rows(result: Result, command: str) -> dict[str, str]:
    last = result.history[-1]
    rows = {
        "steps": f"{last['steps']:,.0f}",
        "time, with compilation": f"{last['seconds']:.1f} s",
        "diverged environments": f"{sum(r['nonfinite'] for r in result.history):,.0f}",
        "steps that lost contacts": f"{sum(r['lost_contacts'] for r in result.history):,.0f}",
        "checkpoints and logs": str(result.directory),
        "go on with": command,
    }
    if result.evaluations:
        row = result.evaluations[-1]
        spread = f"{row['eval_return']:,.1f} +- {row['eval_return_std']:,.1f}"
        rows = {"return of the policy": spread, **rows}
    return rows


def _next(arguments: argparse.Namespace, result: Result) -> str:
    """The command that plays the policy, or that continues the training."""
    words = ["jaxsim", "play", str(result.directory)]
    if result.interrupted:
        words = ["jaxsim", "train", arguments.env, "--resume", str(result.directory)]
    elif ":" in arguments.env:
        words += ["--env", arguments.env]
    if arguments.algorithm and ":" in arguments.algorithm:
        words += ["--algorithm", arguments.algorithm]
    return shlex.join(words)


def _directory(env: str, algorithm: str) -> pathlib.Path:
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    name = "-".join((env, algorithm, now))
    return pathlib.Path("runs") / name.replace(":", ".").replace("/", "-")
