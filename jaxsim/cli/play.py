"""`jaxsim play`: evaluate a trained policy and show an episode."""

import argparse

import jax
import rich
import rich.console
import rich.table

from jaxsim import rl
from jaxsim.cli import UsageError
from jaxsim.cli.episode import save_video
from jaxsim.rl import checkpoint, driver


def run(arguments: argparse.Namespace) -> int:
    """Evaluate, draw, report; returns the exit status."""
    try:
        settings = checkpoint.read_run(arguments.checkpoint)
        env = driver.run_env(settings)
        policy = driver.load_policy(arguments.checkpoint, env)
    except (rl.ConfigError, checkpoint.CheckpointError) as error:
        raise UsageError(error) from error
    keys = jax.random.split(jax.random.key(arguments.seed), arguments.episodes)
    limit = settings["settings"]["evaluation_steps"]
    result = jax.jit(lambda policy, keys: rl.evaluate(env, policy, keys, limit))(policy, keys)
    rich.print(_report(settings, result))
    if arguments.video:
        note = save_video(env, policy, arguments.checkpoint / "episode", arguments.seed)
        rich.console.Console(stderr=True, soft_wrap=True).print(note)
    return 0


def _report(settings, result) -> rich.table.Table:
    numbers = result.metrics()
    table = rich.table.Table(show_header=False, box=None)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    table.add_row("environment", f"{settings['env']}, trained by {settings['algorithm']}")
    table.add_row("episodes", f"{result.returns.shape[0]:,}")
    table.add_row("return", f"{numbers['eval_return']:,.1f} +- {numbers['eval_return_std']:,.1f}")
    table.add_row("worst return", f"{numbers['eval_return_min']:,.1f}")
    table.add_row("length", f"{numbers['eval_length']:,.1f} steps")
    return table
