"""Functions of all joints of a model: one `vmap` for each group of types that share a function."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxsim.arrays.kinds import Rows, apply_by_kind
from jaxsim.joints import JOINTS, Joint
from jaxsim.model import Model


def shared_type(types: np.ndarray, *fields: str) -> np.ndarray:
    """(n,) the first type in `types` whose sizes and fields equal those of each joint's type.

    Args:
      types: (n,) types of the joints.
      fields: names of fields of `Joint`.
    """
    first: dict[tuple, int] = {}
    keys = (tuple(getattr(JOINTS[int(t)], f) for f in ("nq", "nv", *fields)) for t in types)
    return np.array([first.setdefault(k, int(t)) for k, t in zip(keys, types, strict=True)], int)


def per_joint(
    types: np.ndarray,
    fields: tuple[str, ...],
    function: Callable[[Joint], Callable],
    *inputs: jax.Array | Rows,
    empty: Any,
    start: np.ndarray | None = None,
) -> Any:
    """`function(joint)(inputs[0][i], ...)` for all joints i.

    Types with equal `fields` are computed together.

    Args:
      types: (n,) types of the joints.
      fields: names of the fields of `Joint` that `function` reads.
      function: from a type to the function of one joint.
      inputs: arrays over the joints, or `position_rows` and `velocity_rows`.
      empty: as in `apply_by_kind`.
      start: as in `apply_by_kind`.
    """
    kinds = shared_type(types, *fields)
    functions = {int(k): function(JOINTS[int(k)]) for k in np.unique(kinds)}
    return apply_by_kind(kinds, functions, *inputs, empty=empty, start=start)


def position_rows(model: Model, x: jax.Array, joints: np.ndarray | None = None) -> Rows:
    """The rows of each joint in an array over `qpos`; `joints` None stands for all, in order."""
    return _rows(x, model.jnt_qposadr, model.jnt_type, "nq", joints)


def velocity_rows(model: Model, x: jax.Array, joints: np.ndarray | None = None) -> Rows:
    """The rows of each joint in an array over `qvel`; `joints` None stands for all, in order."""
    return _rows(x, model.jnt_dofadr, model.jnt_type, "nv", joints)


def turning(types: np.ndarray) -> np.ndarray:
    """(nv,) whether each motion axis turns with its link, for joints of these types in order."""
    return np.array([turns for t in types for turns in JOINTS[int(t)].turns], bool)


def _rows(x, start: np.ndarray, types: np.ndarray, size: str, joints) -> Rows:
    joints = np.arange(len(types)) if joints is None else joints
    sizes = np.array([getattr(JOINTS[int(t)], size) for t in types[joints]], int)
    return Rows(x, np.asarray(start, int)[joints], sizes)
