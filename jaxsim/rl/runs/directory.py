"""The directory of a run, locked by one process at a time, with settings in "run.yaml"."""

import contextlib
import pathlib
import shutil
from collections.abc import Iterator
from typing import Any

import yaml

from jaxsim.rl import config
from jaxsim.rl.checkpoint import FOLDER
from jaxsim.rl.errors import CheckpointError, ConfigError
from jaxsim.rl.metrics import ROWS, replace

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_RUN, _LOCK = "run.yaml", ".lock"
_KINDS = {"env": str | None, "algorithm": str, "seed": int, "settings": dict}


@contextlib.contextmanager
def hold(directory: pathlib.Path, resume: bool) -> Iterator[None]:
    """Create the directory if needed, and lock it while the context is open.

    Args:
      directory: directory of the run.
      resume: whether it may already contain a run.

    Raises:
      CheckpointError: it cannot be written to, is in use by another process, or contains a run.
    """
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        lock = (directory / _LOCK).open("a")
    with lock:
        _lock(lock, directory)
        if not resume and _has_run(directory):
            raise CheckpointError(
                f"{directory} holds a run already; resume it, or choose another directory"
            )
        yield


def _lock(file: Any, directory: pathlib.Path) -> None:
    """Lock a file for this process; the lock ends with the process, even if it crashes."""
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise CheckpointError(f"{directory} is in use by another run") from error
    except OSError:
        return  # a file system without locks


def _has_run(directory: pathlib.Path) -> bool:
    """Whether the directory contains results of a training, not only its start."""
    begun = (directory / _RUN).exists()
    return begun and ((directory / ROWS).exists() or any((directory / FOLDER).glob("*")))


def check_space(directory: pathlib.Path, needed: int) -> None:
    """Raise a CheckpointError if the disk has no space for `needed` bytes of checkpoints."""
    free = shutil.disk_usage(directory).free
    if free < needed:
        raise CheckpointError(
            f"{directory} has {free / 1e6:,.0f} MB left, the checkpoints of this run need "
            f"{needed / 1e6:,.0f} MB"
        )


def write_run(directory: pathlib.Path, run: dict[str, Any]) -> None:
    """Write "run.yaml", atomically.

    Raises:
      CheckpointError: it cannot be written.
      ConfigError: YAML cannot represent a setting.
    """
    try:
        text = yaml.safe_dump(run, sort_keys=False)
    except yaml.YAMLError as error:
        raise ConfigError(
            f"settings of a run with a directory must be plain numbers and words: {error}"
        ) from error
    with writing(directory):
        replace(directory / _RUN, text)


def check_same(directory: pathlib.Path, run: dict[str, Any]) -> None:
    """Check that a training is the one in the directory, if there is one.

    Raises:
      CheckpointError: it is a different training, or the file in the directory is damaged.
    """
    if not (directory / _RUN).exists():
        return
    stored = read_run(directory)
    for name in ("env", "algorithm"):
        if None not in (stored[name], run[name]) and stored[name] != run[name]:
            raise CheckpointError(
                f"the run in {directory} is about {stored[name]}, not {run[name]}"
            )


def read_run(directory: str | pathlib.Path) -> dict[str, Any]:
    """Read "run.yaml": "env", "algorithm", "seed" and "settings".

    Raises:
      CheckpointError: it is not the directory of a run, or the file is damaged.
    """
    path = pathlib.Path(directory) / _RUN
    if not path.is_file():
        raise CheckpointError(f"{directory} is not the directory of a run: it has no {_RUN}")
    try:
        run = config.read(path)
    except ConfigError as error:
        raise CheckpointError(f"damaged: {error}") from error
    for name, kind in _KINDS.items():
        if name not in run or not isinstance(run[name], kind):
            found = repr(run[name])[:100] if name in run else "nothing"
            raise CheckpointError(f"{path} is damaged: its entry {name!r} is {found}")
    return run


@contextlib.contextmanager
def writing(directory: pathlib.Path) -> Iterator[None]:
    """Turn errors of the operating system, such as a full disk, into a CheckpointError.

    Raises:
      CheckpointError: something cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"cannot write to {directory}: {error.strerror}") from error
