"""`jaxsim envs`: the environments that `jaxsim train` and `jaxsim.envs.make` know."""

import argparse

import rich
import rich.table

import jaxsim.envs
from jaxsim.envs.describe import describe


def run(_: argparse.Namespace) -> int:
    """Print one line per environment: its name, its sizes and what is to be done in it."""
    table = rich.table.Table(box=None)
    table.add_column("environment", no_wrap=True)
    for size in ("observation", "action", "steps"):
        table.add_column(size, justify="right")
    table.add_column("task")
    for name in jaxsim.envs.names():
        table.add_row(name, *(str(x) for x in _row(name)))
    rich.print(table)
    return 0


def _row(name: str) -> tuple[int | str, int | str, int | str, str]:
    """Sizes of observation and action, length of an episode, and what is to be done."""
    spec = jaxsim.envs.spec(name)
    page = describe(spec.load())
    sizes = page.sizes.get("observation", "-"), page.sizes.get("action", "-")
    return *sizes, spec.max_episode_steps or "-", page.summary
