"""`jaxsim train`: a policy from nothing, with logs, checkpoints, a curve and a video."""

import argparse
import datetime
import pathlib

from jaxsim import rl
from jaxsim.cli import UsageError
from jaxsim.cli.episode import save_video
from jaxsim.cli.report import note, report
from jaxsim.cli.simulate import prepare_cpu
from jaxsim.rl import checkpoint, distributed
from jaxsim.rl.driver import run_env
from jaxsim.rl.metrics import read
from jaxsim.viz.curves import plot_learning


def run(arguments: argparse.Namespace) -> int:
    """Train, draw, report; returns the exit status."""
    if arguments.processes > 1:
        distributed.join(arguments.coordinator, arguments.processes, arguments.process)
    else:
        prepare_cpu()
    try:
        return _train(arguments)
    except (rl.ConfigError, checkpoint.CheckpointError) as error:
        raise UsageError(error) from error


def _train(arguments: argparse.Namespace) -> int:
    directory = arguments.out or _directory(arguments)
    settings, seed, algorithm = arguments.config, arguments.seed, arguments.algorithm
    if arguments.resume:
        directory = arguments.resume
        stored = checkpoint.read_run(directory)
        settings, seed, algorithm = stored["settings"], stored["seed"], stored["algorithm"]
        if stored["env"] != arguments.env:
            raise UsageError(
                f"the run in {directory} is about {stored['env']}, not {arguments.env}"
            )
    result = rl.train(
        arguments.env,
        algorithm,
        settings,
        overrides=arguments.set,
        seed=seed,
        directory=directory,
        resume=arguments.resume is not None,
        progress=True,
    )
    if distributed.is_main():
        _finish(arguments, result)
    return 130 if result.interrupted else 0


def _finish(arguments: argparse.Namespace, result) -> None:
    """Curve, video, report."""
    notes = [_curve(arguments.env, result.directory)]
    if arguments.video and not result.interrupted:
        env = run_env(checkpoint.read_run(result.directory))
        notes.append(save_video(env, result.policy, result.directory / "episode", arguments.seed))
    report(_rows(result))
    for text in notes:
        note(text)


def _curve(name: str, directory: pathlib.Path) -> str:
    path = directory / "curve.png"
    try:
        plot_learning({"deterministic policy": read(directory / "metrics.jsonl")}, path, name)
    except RuntimeError as error:
        return f"no learning curve: {error}"
    return f"learning curve: {path}"


def _rows(result) -> dict[str, str]:
    last = result.history[-1] if result.history else {"steps": 0, "seconds": 0.0}
    verb = "train ... --resume" if result.interrupted else "play"
    rows = {
        "steps": f"{last['steps']:,.0f}",
        "time, with compilation": f"{last['seconds']:.1f} s",
        "diverged environments": f"{sum(r['nonfinite'] for r in result.history):,.0f}",
        "checkpoints and logs": str(result.directory),
        "go on with": f"jaxsim {verb} {result.directory}",
    }
    if result.evaluations:
        row = result.evaluations[-1]
        spread = f"{row['eval_return']:,.1f} +- {row['eval_return_std']:,.1f}"
        rows = {"return of the policy": spread, **rows}
    return rows


def _directory(arguments: argparse.Namespace) -> pathlib.Path:
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    return pathlib.Path("runs") / f"{arguments.env}-{arguments.algorithm}-{now}"
