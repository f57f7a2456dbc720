"""Checkpoints of a whole training, from which it continues bit by bit as without interruption."""

import contextlib
import logging
import pathlib
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import orbax.checkpoint as ocp

from jaxsim.rl.errors import CheckpointError
from jaxsim.rl.runs import manifest

FOLDER = "checkpoints"
KEPT = 2  # the newest ones


class Checkpoints:
    """The checkpoints in the directory of a run, of which the newest are kept.

    If a checkpoint cannot be read or is damaged, an older one is used, with a warning.

    Attributes:
      directory: directory of the run; checkpoints are in its folder "checkpoints".
    """

    def __init__(self, directory: str | pathlib.Path, read_only: bool = False):
        """Open the checkpoints in an existing directory.

        Args:
          directory: directory of the run.
          read_only: whether to change nothing in it.
        """
        self.directory = pathlib.Path(directory).resolve()
        self._folder = self.directory / FOLDER
        if read_only and not self._folder.is_dir():
            raise CheckpointError(f"{self.directory} contains no checkpoint")
        options = ocp.CheckpointManagerOptions(
            max_to_keep=None if read_only else KEPT,
            create=not read_only,
            read_only=read_only,
            enable_async_checkpointing=False,
        )
        with _quiet():
            self._manager = ocp.CheckpointManager(self._folder, options=options)

    def save(self, steps: int, training: Any, policy: Any, progress: dict[str, Any]) -> None:
        """Write a checkpoint; all processes must call it.

        Args:
          steps: environment steps so far, the name of the checkpoint.
          training: the state of the training.
          policy: the policy, which is also in `training`; stored separately for playing.
          progress: JSON-like numbers, such as the seconds so far.

        Raises:
          CheckpointError: it cannot be written, for instance because the disk is full.
        """
        if steps in self.steps():
            return
        trees = {"training": _pack(training), "policy": _pack(policy)}
        shapes = {name: _shapes(tree) for name, tree in trees.items()}
        args: dict[str, Any] = {n: ocp.args.StandardSave(tree) for n, tree in trees.items()}
        args["progress"] = ocp.args.JsonSave(progress | {"shapes": shapes})
        try:
            self._manager.save(steps, args=ocp.args.Composite(**args))
            if jax.process_index() == 0:
                manifest.write(self._folder / str(steps))
        except Exception as error:
            raise CheckpointError(
                f"cannot write the checkpoint of step {steps} to {self.directory}: {_reason(error)}"
            ) from error

    def steps(self) -> list[int]:
        """Steps of all checkpoints, oldest first."""
        return sorted(self._manager.all_steps())

    def latest(self) -> int | None:
        """Steps of the newest checkpoint; None if there is none."""
        return self._manager.latest_step()

    def restore(self, training: Any) -> tuple[int, Any, dict[str, Any]]:
        """The newest state that can be read; newer checkpoints are removed.

        Args:
          training: a tree of arrays or `jax.ShapeDtypeStruct`s with the wanted shardings.

        Returns:
          The steps, the state of the training, and the progress.

        Raises:
          CheckpointError: there is no checkpoint that fits.
        """
        step, restored, progress = self._newest("training", training)
        for newer in self.steps():
            if newer > step:
                self._manager.delete(newer)
        return step, restored, progress

    def restore_policy(self, policy: Any) -> Any:
        """The newest policy that can be read, as a tree like `policy`; errors as for `restore`."""
        return self._newest("policy", policy)[1]

    def close(self) -> None:
        """Wait until everything is written."""
        self._manager.close()

    def _newest(self, name: str, like: Any) -> tuple[int, Any, dict[str, Any]]:
        problems = []
        for step in reversed(self.steps()):
            try:
                restored, progress = self._read(step, name, like)
            except Exception as error:
                problems.append(f"checkpoint {step} cannot be used: {_reason(error)}")
                continue
            for problem in problems:
                warnings.warn(f"{self.directory}: {problem}; going back to {step}", stacklevel=4)
            return step, restored, progress
        found = "; ".join(problems) or "it contains no checkpoint"
        raise CheckpointError(f"{self.directory}: {found}")

    def _read(self, step: int, name: str, like: Any) -> tuple[Any, dict[str, Any]]:
        manifest.check(self._folder / str(step))
        packed = _pack(like)
        progress = dict(self._item(step, "progress", ocp.args.JsonRestore()))
        _check_shapes(progress.pop("shapes")[name], _shapes(packed))
        found = self._item(step, name, ocp.args.StandardRestore(packed))
        return _unpack(found, like), progress

    def _item(self, step: int, name: str, args: Any) -> Any:
        return self._manager.restore(step, args=ocp.args.Composite(**{name: args}))[name]


@contextlib.contextmanager
def _quiet():
    """Orbax warns of what was asked for: that nothing is written to a directory only to be read."""
    logger = logging.getLogger("absl")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _shapes(leaves: dict[str, Any]) -> dict[str, list[int]]:
    return {name: list(x.shape) for name, x in leaves.items()}


def _check_shapes(stored: dict[str, list[int]], wanted: dict[str, list[int]]) -> None:
    """Raise a ValueError if shapes or types differ, which orbax would convert."""
    for name in sorted(stored.keys() | wanted.keys()):
        have, want = stored.get(name), wanted.get(name)
        if have != want:
            raise CheckpointError(
                f"it is of another environment or of other settings: {name} is of shape {have}, "
                f"here of {want}"
            )


def _reason(error: Exception) -> str:
    """The first line of an error; those of orbax have many."""
    return next(iter(str(error).splitlines()), "")[:200] or type(error).__name__


def _pack(tree: Any) -> dict[str, Any]:
    """The leaves by name, in a form for orbax: no empty arrays, random keys as integers."""
    leaves = {jax.tree_util.keystr(path): x for path, x in jax.tree.leaves_with_path(tree)}
    return {name: _plain(x) for name, x in leaves.items() if x.size}


def _unpack(leaves: dict[str, Any], like: Any) -> Any:
    """The tree whose leaves were packed."""

    def leaf(path, old):
        if not old.size:
            return jnp.zeros(old.shape, old.dtype, device=old.sharding)
        new = leaves[jax.tree_util.keystr(path)]
        return jax.random.wrap_key_data(new) if _is_key(old) else new

    return jax.tree_util.tree_map_with_path(leaf, like)


def _is_key(x: Any) -> bool:
    return jnp.issubdtype(x.dtype, jax.dtypes.prng_key)


def _plain(x: Any) -> Any:
    if not _is_key(x):
        return x
    if not isinstance(x, jax.ShapeDtypeStruct):
        return jax.random.key_data(x)
    data = jax.eval_shape(jax.random.key_data, x)
    return jax.ShapeDtypeStruct(data.shape, data.dtype, sharding=x.sharding)
