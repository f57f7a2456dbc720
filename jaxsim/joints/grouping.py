"""Computing with all joints of a model: once for each group of types that answer alike."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxsim.arrays.kinds import Rows, apply_by_kind
from jaxsim.joints import JOINTS, Joint
from jaxsim.model import Model


def alike(types: np.ndarray, *questions: str) -> np.ndarray:
    """(n,) for each joint the first type that answers these questions as its own type does."""
    first: dict[tuple, int] = {}
    answers = (tuple(getattr(JOINTS[int(t)], q) for q in ("nq", "nv", *questions)) for t in types)
    pairs = [first.setdefault(a, int(t)) for a, t in zip(answers, types, strict=True)]
    return np.array(pairs, int)


def per_joint(
    types: np.ndarray,
    questions: tuple[str, ...],
    function: Callable[[Joint], Callable],
    *inputs: jax.Array | Rows,
    empty: Any,
    start: np.ndarray | None = None,
) -> Any:
    """`function(joint)(inputs[0][i], ...)` for all joints i, for one group of types at a time.

    Args:
      types: (n,) types of the joints.
      questions: the fields of a `Joint` that `function` depends on.
      function: from a type to the function of one joint.
      inputs: arrays over the joints, or `position_rows` and `velocity_rows`.
      empty: as in `apply_by_kind`.
      start: as in `apply_by_kind`.
    """
    kinds = alike(types, *questions)
    functions = {int(k): function(JOINTS[int(k)]) for k in np.unique(kinds)}
    return apply_by_kind(kinds, functions, *inputs, empty=empty, start=start)


def position_rows(model: Model, x: jax.Array, joints: np.ndarray | None = None) -> Rows:
    """The rows of each joint in an array over `qpos`; of some joints, or of all in order."""
    return _rows(x, model.jnt_qposadr, model.jnt_type, "nq", joints)


def velocity_rows(model: Model, x: jax.Array, joints: np.ndarray | None = None) -> Rows:
    """The rows of each joint in an array over `qvel`; of some joints, or of all in order."""
    return _rows(x, model.jnt_dofadr, model.jnt_type, "nv", joints)


def turning(types: np.ndarray) -> np.ndarray:
    """(nv,) which motion axes of joints of these types, in this order, turn with their links."""
    return np.array([turns for t in types for turns in JOINTS[int(t)].turns], bool)


def _rows(x, start: np.ndarray, types: np.ndarray, size: str, joints) -> Rows:
    joints = np.arange(len(types)) if joints is None else joints
    sizes = np.array([getattr(JOINTS[int(t)], size) for t in types[joints]], int)
    return Rows(x, np.asarray(start, int)[joints], sizes)
