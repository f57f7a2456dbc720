"""The command line `jaxsim`.

This file only reads arguments. Each command lives in a file of its own that is imported when the
command runs, so that `jaxsim --help` needs neither JAX nor MuJoCo.
"""

import argparse
import importlib
import sys
from collections.abc import Sequence

_OVERVIEW = """\
Simulate rigid bodies by the thousand, with MuJoCo's physics in JAX.

examples:
  jaxsim models                                 what comes with the package
  jaxsim simulate humanoid                      1024 humanoids, 1000 steps each
  jaxsim simulate my_robot.xml --ctrl zero      a file of yours, MJCF or URDF
"""

_SIMULATE = """\
Simulate many copies of one model and report how fast that went.

Every environment starts at the model's initial position with small random velocities of its own.
The batch is split over all devices; on a CPU each core is one device.
"""

_SIMULATE_EXAMPLES = """\
examples:
  jaxsim simulate humanoid
  jaxsim simulate ant --envs 4096 --steps 200 --seed 7
  jaxsim simulate box_on_plane --keyframe throw
  jaxsim simulate my_robot.xml --ctrl zero --timestep 0.001

exit status:
  0  all environments stayed finite
  1  some environment diverged to NaN or infinity; the report says what to do
  2  the command was not understood, or the model could not be loaded
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
      argv: the arguments after the program's name; those of the process by default.

    Returns:
      The exit status: 0 on success, 1 if the simulation diverged, 2 for a mistake in the request.
    """
    arguments = _parser().parse_args(argv)
    command = importlib.import_module(f"jaxsim.cli.{arguments.command}")
    try:
        return command.run(arguments)
    except UsageError as error:
        print(f"jaxsim: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("jaxsim: interrupted", file=sys.stderr)
        return 130


class UsageError(Exception):
    """A request that cannot be met, told to the user in one sentence and without a traceback."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxsim", description=_OVERVIEW, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_simulate(commands)
    commands.add_parser(
        "models", help="list the bundled models", description="List the bundled models."
    )
    return parser


def _add_simulate(commands) -> None:
    simulate = commands.add_parser(
        "simulate",
        help="simulate many copies of a model",
        description=_SIMULATE,
        epilog=_SIMULATE_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    option = simulate.add_argument
    option("model", metavar="MODEL", help="a .xml or .urdf file, or the name of a bundled model")
    option("--envs", type=_positive(int), default=1024, help="number of environments (1024)")
    option("--steps", type=_positive(int), default=1000, help="steps of each environment (1000)")
    option("--seed", type=int, default=0, help="seed of initial velocities and controls (0)")
    option(
        "--ctrl",
        choices=("random", "zero"),
        default="random",
        help="controls: uniform in their ranges, drawn anew every chunk (default), or zero",
    )
    option(
        "--chunk",
        type=_positive(int),
        default=50,
        help="steps between two progress reports; they run in one compiled call (50)",
    )
    option("--keyframe", metavar="NAME", help="start at this keyframe instead of qpos0")
    option("--timestep", type=_positive(float), metavar="SECONDS", help="instead of the model's")


def _positive(number):
    def parse(text: str):
        value = number(text)
        if not 0 < value < float("inf"):
            raise argparse.ArgumentTypeError(f"must be positive, got {text}")
        return value

    parse.__name__ = number.__name__
    return parse
