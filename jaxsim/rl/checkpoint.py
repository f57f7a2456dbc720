"""Checkpoints of a whole training: what comes after a resume is bit-identical to not stopping."""

import pathlib
from typing import Any

import jax
import jax.numpy as jnp
import orbax.checkpoint as ocp
import yaml

_STATE = "checkpoints"


class CheckpointError(ValueError):
    """A directory without a usable checkpoint."""


class Checkpoints:
    """The checkpoints in the directory of a run; the newest ones are kept.

    Attributes:
      directory: of the run; arrays are in its "checkpoints", settings in "run.yaml".
    """

    def __init__(self, directory: str | pathlib.Path, keep: int = 2):
        self.directory = pathlib.Path(directory).resolve()
        options = ocp.CheckpointManagerOptions(
            max_to_keep=keep, create=True, enable_async_checkpointing=False
        )
        self._manager = ocp.CheckpointManager(self.directory / _STATE, options=options)

    def save(self, steps: int, training: Any, policy: Any, progress: dict[str, Any]) -> None:
        """Write a checkpoint; all processes must call it.

        Args:
          steps: environment steps so far, the name of the checkpoint.
          training: everything that training carries on with.
          policy: the present policy, also inside `training`, on its own for those who only play.
          progress: JSON-like numbers, such as the seconds so far.
        """
        if steps in self._manager.all_steps():
            return
        self._manager.save(
            steps,
            args=ocp.args.Composite(
                training=ocp.args.StandardSave(_pack(training)),
                policy=ocp.args.StandardSave(_pack(policy)),
                progress=ocp.args.JsonSave(progress),
            ),
        )

    def latest(self) -> int | None:
        """Steps of the newest checkpoint; None if there is none."""
        return self._manager.latest_step()

    def restore(self, training: Any) -> tuple[Any, dict[str, Any]]:
        """The newest state and its progress.

        Args:
          training: a tree of arrays or `jax.ShapeDtypeStruct`s with the wanted shardings.

        Raises:
          CheckpointError: there is none.
        """
        args = ocp.args.Composite(
            training=ocp.args.StandardRestore(_pack(training)),
            progress=ocp.args.JsonRestore(),
        )
        found = self._manager.restore(self._step(), args=args)
        return _unpack(found["training"], training), found["progress"]

    def restore_policy(self, policy: Any) -> Any:
        """The newest policy, as a tree like `policy`."""
        args = ocp.args.Composite(policy=ocp.args.StandardRestore(_pack(policy)))
        return _unpack(self._manager.restore(self._step(), args=args)["policy"], policy)

    def close(self) -> None:
        """Finish what is being written."""
        self._manager.close()

    def _step(self) -> int:
        step = self.latest()
        if step is None:
            raise CheckpointError(f"{self.directory} contains no checkpoint")
        return step


def write_run(directory: pathlib.Path, run: dict[str, Any], resume: bool) -> None:
    """Write the settings that a run was started with.

    Raises:
      CheckpointError: the directory holds a run already, and is not to be resumed.
    """
    if not resume and (directory / "run.yaml").exists():
        raise CheckpointError(
            f"{directory} holds a run already; resume it, or choose another directory"
        )
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "run.yaml").write_text(yaml.safe_dump(run, sort_keys=False), "utf-8")


def read_run(directory: str | pathlib.Path) -> dict[str, Any]:
    """Settings of the run in a directory.

    Raises:
      CheckpointError: it is not the directory of a run.
    """
    path = pathlib.Path(directory) / "run.yaml"
    if not path.is_file():
        raise CheckpointError(f"{directory} is not the directory of a run: it has no run.yaml")
    return yaml.safe_load(path.read_text("utf-8"))


def _pack(tree: Any) -> dict[str, Any]:
    """The leaves by name, as orbax takes them: no empty arrays, random keys as integers."""
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
