"""Simulations in files: a model with its looks, and states of it."""

import pathlib
import tempfile
from typing import Any

import mujoco
import numpy as np

from jaxsim.model import Model, State
from jaxsim.viz.batch import batched
from jaxsim.viz.models import looks_of

# What a picture needs of a state.
_FIELDS = ("qpos", "qvel", "time", "mocap_pos", "mocap_quat")


def save_trajectory(
    path: str | pathlib.Path, model: Model | mujoco.MjModel, trajectory: State
) -> pathlib.Path:
    """Write a model and states of it, for `jaxsim view` and `load_trajectory`.

        jaxsim.viz.save_trajectory("run.npz", model, trajectory)

    Args:
      path: file to write, an archive of NumPy's; its ending becomes `.npz`.
      model: of one environment.
      trajectory: states (T, ...), or (B, T, ...) of several environments.

    Returns:
      The file written.

    Raises:
      ValueError: shapes do not fit together.
    """
    source = looks_of(model)
    batched(source, trajectory, "trajectory")
    fields: dict[str, Any] = {name: np.asarray(getattr(trajectory, name)) for name in _FIELDS}
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "model.mjb"
        mujoco.mj_saveModel(source, str(file))
        fields["model"] = np.frombuffer(file.read_bytes(), np.uint8)
    path = pathlib.Path(path).with_suffix(".npz")
    np.savez_compressed(path, **fields)
    return path


def load_trajectory(path: str | pathlib.Path) -> tuple[mujoco.MjModel, State]:
    """The model and the states of a file by `save_trajectory`.

    Returns:
      MuJoCo's model, which all of `jaxsim.viz` takes and `jaxsim.load` makes ours; and states with
      what a picture needs, the rest of them zero.

    Raises:
      ValueError: the file is none of these, or was written with another version of MuJoCo.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = {name: archive[name] for name in ("model", *_FIELDS)}
    except (KeyError, ValueError, EOFError) as error:
        raise ValueError(f"{path} is no file of jaxsim.viz.save_trajectory") from error
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "model.mjb"
        file.write_bytes(found.pop("model").tobytes())
        try:
            model = mujoco.MjModel.from_binary_path(str(file))
        except (ValueError, mujoco.FatalError) as error:
            raise ValueError(
                f"{path} was written with another version of MuJoCo than {mujoco.__version__}"
            ) from error
    return model, _states(model, found)


def _states(model: mujoco.MjModel, found: dict[str, np.ndarray]) -> State:
    lead = found["qpos"].shape[:-1]
    zeros = {
        "act": np.zeros((*lead, model.na)),
        "qacc_warmstart": np.zeros((*lead, model.nv)),
        "qfrc_applied": np.zeros((*lead, model.nv)),
        "xfrc_applied": np.zeros((*lead, model.nbody, 6)),
    }
    return State(**found, **zeros)  # type: ignore[arg-type]
