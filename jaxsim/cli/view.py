"""`jaxsim view`: a model, a policy or a stored simulation, in the browser or in MuJoCo's window."""

import argparse
import pathlib
import webbrowser

import jaxsim
from jaxsim.cli import UsageError
from jaxsim.cli.report import note
from jaxsim.viz import html, live
from jaxsim.viz.recording import load_trajectory


def run(arguments: argparse.Namespace) -> int:
    """Show it until the user interrupts; returns the exit status."""
    what = pathlib.Path(arguments.what)
    if what.suffix == ".npz":
        return _replay(arguments, what)
    source = _policy(arguments, what) if what.is_dir() else _model(arguments)
    try:
        if arguments.window:
            note("compiling; then the window opens")
            live.in_window(source)
        else:
            live.in_browser(
                source,
                host=arguments.host,
                port=arguments.port,
                title=f"jaxsim {what.name}",
                ready=lambda url: _open(arguments, url),
            )
    except RuntimeError as error:
        raise UsageError(error) from error
    except KeyboardInterrupt:  # the usual end
        pass
    return 0


def _open(arguments: argparse.Namespace, url: str) -> None:
    note(f"{arguments.what} is at {url}; Ctrl-C ends it")
    if arguments.open:
        webbrowser.open(url)


def _replay(arguments: argparse.Namespace, file: pathlib.Path) -> int:
    """A page beside the file, which the browser plays by itself."""
    try:
        page = html(*load_trajectory(file), title=file.stem).save(file.with_suffix(".html"))
    except (OSError, ValueError) as error:
        raise UsageError(error) from error
    note(f"the page is {page}")
    if arguments.open:
        webbrowser.open(page.resolve().as_uri())
    return 0


def _model(arguments: argparse.Namespace) -> live.Free:
    try:
        return live.Free(jaxsim.load(arguments.what), arguments.keyframe)
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(error.args[0] if isinstance(error, KeyError) else error) from error


def _policy(arguments: argparse.Namespace, folder: pathlib.Path) -> live.Played:
    from jaxsim.rl import checkpoint, driver, errors
    from jaxsim.rl.runs import directory

    try:
        settings = directory.read_run(folder)
        env = driver.run_env(settings, arguments.env, arguments.algorithm)
        policy = driver.load_policy(folder, env, arguments.algorithm)
    except (errors.ConfigError, checkpoint.CheckpointError) as error:
        raise UsageError(error) from error
    return live.Played(env, policy)
