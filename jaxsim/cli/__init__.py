"""The command line `jaxsim`.

This file only reads arguments. Each command lives in a file of its own that is imported when the
command runs.
"""

import argparse
import importlib
import pathlib
import sys
from collections.abc import Sequence

import jaxsim

_OVERVIEW = """\
Simulate rigid bodies by the thousand, with MuJoCo's physics in JAX.

examples:
  jaxsim models                                 what comes with the package
  jaxsim envs                                   tasks to train on
  jaxsim simulate humanoid                      1024 humanoids, 1000 steps each
  jaxsim simulate my_robot.xml --ctrl zero      a file of yours, MJCF or URDF
  jaxsim inspect my_robot.xml                   what it has, what is refused, what it costs
  jaxsim train inverted_pendulum                a policy in less than a minute
  jaxsim play runs/...                          what it has learnt
  jaxsim view humanoid                          live in the browser, to push and pull
  jaxsim optimize cartpole                      plan a swing-up, and film it
  jaxsim bench throughput --models humanoid     speed beside MuJoCo C
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

_INSPECT = """\
Say what a model has, what jaxsim refuses and why, and what it costs: pairs of geoms that may
touch, slots for contacts, memory; with --speed also compilation and steps per second beside
MuJoCo C.
"""

_INSPECT_EXAMPLES = """\
examples:
  jaxsim inspect humanoid
  jaxsim inspect my_robot.urdf --speed
  jaxsim inspect my_robot.xml --drop-pairs

exit status:
  0  the model loads
  1  it is refused; every reason is listed
  2  the command was not understood, or the file is no model
"""

_VIEW = """\
Show something that moves: pause, speed, contact forces; bodies can be pulled with the mouse.

MODEL       a .xml or .urdf file or the name of a bundled model: sliders move its actuators
RUN         a directory of `jaxsim train`: its policy acts
TRAJECTORY  a .npz file of `jaxsim.viz.save_trajectory`: becomes a page that plays it
"""

_VIEW_EXAMPLES = """\
examples:
  jaxsim view humanoid
  jaxsim view runs/hopper-ppo-20260101-120000
  jaxsim view run.npz
  jaxsim view my_robot.xml --window             where there is a display

The page needs viser: pip install viser, or in a clone pip install ".[view]".
"""

_TRAIN = """\
Train a policy in thousands of environments at once.

Settings come from the tuned file for this environment, where jaxsim has one; --config names
another file, and --set changes single values. On a GPU, what such a file has under "gpu" takes the
place of other values: more environments, fewer and larger gradient steps.

Everything is written to one directory: settings (run.yaml), numbers (metrics.jsonl, tensorboard),
checkpoints, the learning curve (curve.png) and an episode of the trained policy (episode.mp4 or
.gif).

Ctrl-C ends training after the present epoch, with a checkpoint; --resume goes on from there, and
the result is the same to the last bit as without the interrupt.
"""

_TRAIN_EXAMPLES = """\
examples:
  jaxsim train inverted_pendulum
  jaxsim train ant --seed 3 --out runs/ant-3
  jaxsim train hopper --set total_steps=2e6 --set policy.hidden=[128,128]
  jaxsim train cartpole --algorithm shac
  jaxsim train half_cheetah --resume runs/half_cheetah-ppo-20260101-120000
  jaxsim train reacher --set learning_rat=1     an unknown setting is an error that lists the others

on several machines, the same command in each process, with its own --process:
  jaxsim train ant --coordinator host:1234 --processes 2 --process 0

exit status:
  0    done
  2    the command was not understood, or a setting makes no sense
  130  interrupted, and saved
"""

_PLAY = """\
Evaluate the newest checkpoint of a run with the deterministic policy, and draw an episode.
"""

_PLAY_EXAMPLES = """\
examples:
  jaxsim play runs/ant-3
  jaxsim play runs/ant-3 --episodes 1000 --no-video
"""

_OPTIMIZE = """\
Plan a motion by trajectory optimisation from small random controls, report, and film it. Without a
task, list the tasks.
"""

_OPTIMIZE_EXAMPLES = """\
examples:
  jaxsim optimize
  jaxsim optimize cartpole
  jaxsim optimize push --seed 3 --out push.gif

exit status:
  0  the motion reaches its goal
  1  it does not; the report says how far it is from it
  2  the command was not understood
"""

_BENCH = """\
Run a benchmark of a clone of the repository; `jaxsim bench NAME --help` lists its options.

  throughput    steps per second of whole batches, beside MuJoCo C and MJX
  scaling       the same against the size of the batch and the number of cores
  gradients     cost, memory and accuracy of reverse mode through many steps
  trajopt       methods of trajectory optimisation side by side
  stages        the share of each stage in a step
  solver        the constraint problem by itself
  dynamics      the recursions by themselves
  training      returns of trained policies against wall time
  gpu           errors and speed on a GPU, all in some minutes
  gpu_programs  what a step consists of on a GPU, counted without one
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
      argv: the arguments after the program's name; those of the process by default.

    Returns:
      The exit status: 0 on success, 1 if the simulation diverged, 2 for a mistake in the request.
    """
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.command is None:
        parser.print_help()
        return 0
    named = (getattr(arguments, name, None) for name in ("env", "algorithm"))
    if any(":" in name for name in named if name):
        sys.path.append("")  # last, so that files in the current folder cannot replace modules
    command = importlib.import_module(f"jaxsim.cli.{arguments.command}")
    try:
        if getattr(arguments, "cache", False):
            importlib.import_module("jaxsim.cli.cache").enable()
        return command.run(arguments)
    except UsageError as error:
        print(f"jaxsim: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("jaxsim: interrupted", file=sys.stderr)
        return 130


class UsageError(Exception):
    """An invalid request, reported to the user in one sentence without a traceback."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxsim", description=_OVERVIEW, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"jaxsim {jaxsim.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _add_inspect(commands)
    _add_simulate(commands)
    _add_train(commands)
    _add_play(commands)
    _add_view(commands)
    _add_optimize(commands)
    _add_bench(commands)
    _add(commands, "models", "list the bundled models", "List the bundled models.")
    _add(commands, "envs", "list the environments", "List the environments.")
    return parser


def _add(commands, name: str, summary: str, description: str, epilog: str | None = None):
    """Add a command, with its help formatted as written here."""
    return commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _add_train(commands) -> None:
    train = _add(commands, "train", "train a policy", _TRAIN, _TRAIN_EXAMPLES)
    option = train.add_argument
    option("env", metavar="ENV", help="name of an environment; `jaxsim envs` lists them")
    option("--algorithm", help="ppo (default), sac, apg, shac or module:Class")
    option("--config", metavar="FILE", help="YAML file of settings instead of the tuned ones")
    option(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting; may be repeated",
    )
    option("--seed", type=int, default=0, help="seed of everything random (0)")
    where = train.add_mutually_exclusive_group()
    where.add_argument("--out", type=pathlib.Path, metavar="DIR", help="new directory to write to")
    where.add_argument("--resume", type=pathlib.Path, metavar="DIR", help="go on with this run")
    _add_video(train)
    train.add_argument("--watch", action="store_true", help="show the present policy in a browser")
    _add_cache(train)
    option("--coordinator", metavar="HOST:PORT", help="address of the first of several processes")
    option("--processes", type=_positive(int), default=1, help="number of processes (1)")
    option("--process", type=int, default=0, help="index of this process, from 0")


def _add_play(commands) -> None:
    play = _add(commands, "play", "evaluate and show a trained policy", _PLAY, _PLAY_EXAMPLES)
    play.add_argument("checkpoint", type=pathlib.Path, metavar="DIR", help="directory of a run")
    play.add_argument("--env", metavar="ENV", help="the task, where it is code: module:Class")
    play.add_argument("--algorithm", metavar="NAME", help="the same for the algorithm")
    play.add_argument("--episodes", type=_positive(int), default=64, help="how many (64)")
    play.add_argument("--seed", type=int, default=1, help="seed of the starts (1)")
    _add_video(play)
    _add_cache(play)


def _add_view(commands) -> None:
    view = _add(commands, "view", "show a model, a policy or a recording", _VIEW, _VIEW_EXAMPLES)
    option = view.add_argument
    option("what", metavar="MODEL|RUN|TRAJECTORY", help="what to show")
    option("--keyframe", metavar="NAME", help="start a model at this keyframe instead of qpos0")
    option("--env", metavar="ENV", help="the task of a run, where it is code: module:Class")
    option("--algorithm", metavar="NAME", help="the same for the algorithm")
    option("--window", action="store_true", help="MuJoCo's own window instead of the browser")
    option("--host", default="127.0.0.1", help="address of the page (127.0.0.1)")
    option("--port", type=int, default=8080, help="the next free one if it is taken (8080)")
    option("--no-open", dest="open", action="store_false", help="do not open a browser")
    _add_cache(view)


def _add_optimize(commands) -> None:
    optimize = _add(commands, "optimize", "plan a motion", _OPTIMIZE, _OPTIMIZE_EXAMPLES)
    optimize.add_argument("task", metavar="TASK", nargs="?", help="what to plan; lists all if none")
    optimize.add_argument("--seed", type=int, default=0, help="seed of the first controls (0)")
    optimize.add_argument(
        "--out", type=pathlib.Path, metavar="FILE", help=".mp4 or .gif to write (TASK.mp4)"
    )
    _add_video(optimize)
    _add_cache(optimize)


def _add_cache(parser) -> None:
    parser.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        help="do not keep compiled programs for the next time (directory: JAXSIM_CACHE)",
    )


def _add_video(parser) -> None:
    parser.add_argument(
        "--no-video", dest="video", action="store_false", help="do not draw an episode"
    )


def _add_simulate(commands) -> None:
    simulate = _add(
        commands, "simulate", "simulate many copies of a model", _SIMULATE, _SIMULATE_EXAMPLES
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
    _add_cache(simulate)


def _add_inspect(commands) -> None:
    inspect = _add(commands, "inspect", "what a model has and costs", _INSPECT, _INSPECT_EXAMPLES)
    option = inspect.add_argument
    option("model", metavar="MODEL", help="a .xml or .urdf file, or the name of a bundled model")
    option("--drop-pairs", action="store_true", help="let unsupported pairs of geoms not collide")
    option("--speed", action="store_true", help="compile and time a batch, and MuJoCo C")
    option("--envs", type=_positive(int), default=1024, help="environments of that batch (1024)")


def _add_bench(commands) -> None:
    bench = _add(commands, "bench", "run a benchmark", _BENCH)
    names = "throughput scaling gradients trajopt stages solver dynamics training gpu_programs gpu"
    bench.add_argument("benchmark", choices=names.split(), help="which one")
    bench.add_argument("options", nargs=argparse.REMAINDER, help="passed on to it")


def _positive(number):
    def parse(text: str):
        value = number(text)
        if not 0 < value < float("inf"):
            raise argparse.ArgumentTypeError(f"must be positive, got {text}")
        return value

    parse.__name__ = number.__name__
    return parse
