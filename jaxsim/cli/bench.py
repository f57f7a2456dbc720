"""`jaxsim bench`: the benchmarks of a clone of the repository."""

import argparse
import importlib.util
import pathlib
import subprocess
import sys

from jaxsim.cli import UsageError

FOLDER = pathlib.Path(__file__).parents[2] / "benchmarks"


def run(arguments: argparse.Namespace) -> int:
    """Run one benchmark in a separate process, which sets up JAX itself."""
    script = FOLDER / f"{arguments.benchmark}.py"
    if not script.is_file():
        raise UsageError(
            "the benchmarks are not part of an installed package; clone the repository and run "
            'jaxsim bench there, after pip install -e ".[bench]"'
        )
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError('the benchmarks draw their results: pip install -e ".[bench]"')
    return subprocess.call([sys.executable, str(script), *arguments.options])
