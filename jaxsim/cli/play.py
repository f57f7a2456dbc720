"""`jaxsim play`: evaluate a trained policy and show an episode."""

import argparse

import jax

from jaxsim import rl
from jaxsim.cli import UsageError
from jaxsim.cli.episode import save_video
from jaxsim.cli.report import note, report, working
from jaxsim.cli.simulate import prepare_cpu
from jaxsim.rl import checkpoint, driver
from jaxsim.rl.runs import directory


def run(arguments: argparse.Namespace) -> int:
    """Evaluate, draw, report; returns the exit status."""
    prepare_cpu()
    try:
        settings = directory.read_run(arguments.checkpoint)
        env = driver.run_env(settings, arguments.env, arguments.algorithm)
        policy = driver.load_policy(arguments.checkpoint, env, arguments.algorithm)
    except (rl.ConfigError, checkpoint.CheckpointError) as error:
        raise UsageError(error) from error
    keys = jax.random.split(jax.random.key(arguments.seed), arguments.episodes)
    limit = env.episode_limit or settings["settings"].get("evaluation_steps")
    with working(f"compiling, and playing {arguments.episodes:,} episodes"):
        evaluate = jax.jit(lambda policy, keys: rl.evaluate(env, policy, keys, limit))
        numbers = (result := evaluate(policy, keys)).metrics()
    report(
        {
            "environment": f"{settings['env']}, trained by {settings['algorithm']}",
            "episodes": f"{result.returns.shape[0]:,}",
            "return": f"{numbers['eval_return']:,.1f} +- {numbers['eval_return_std']:,.1f}",
            "worst return": f"{numbers['eval_return_min']:,.1f}",
            "length": f"{numbers['eval_length']:,.1f} steps",
        }
    )
    if arguments.video:
        note(save_video(env, policy, arguments.checkpoint / "episode", arguments.seed))
    return 0
