"""`jaxsim envs`: the environments that `jaxsim train` and `jaxsim.envs.make` know."""

import argparse

import jaxsim.envs
from jaxsim.cli.report import listing
from jaxsim.envs.registry.describe import describe


def run(_: argparse.Namespace) -> int:
    """Print one line for each environment: its name, its sizes and its task."""
    rows = ((name, *_row(name)) for name in jaxsim.envs.names())
    listing("environment", ("observation", "action", "steps"), "task", rows)
    return 0


def _row(name: str) -> tuple[int | str, int | str, int | str, str]:
    """Sizes of observation and action, length of an episode, and the task."""
    spec = jaxsim.envs.spec(name)
    page = describe(spec.load())
    sizes = page.sizes.get("observation", "-"), page.sizes.get("action", "-")
    return *sizes, spec.max_episode_steps or "-", page.summary
