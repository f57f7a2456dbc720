"""Candidate pairs of geoms without a pair function."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxsim.collision.table import PAIRS, supported_pairs, type_name
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

_NAMED = 10  # most pairs that a message names
# For dynamic pairs, and for explicit pairs, to which these filters do not apply.
_REMEDIES = (
    "set contype and conaffinity to 0 on one of them or add an <exclude> for their bodies",
    "remove their <pair>",
)


def is_supported(model: Any, rows: np.ndarray) -> np.ndarray:
    """(n,) whether each candidate pair has a pair function."""
    types = np.asarray(model.geom_type)[rows[:, :2]].tolist()
    return np.array([tuple(pair) in PAIRS for pair in types], bool)


def unsupported_pairs(model: Any, rows: np.ndarray, label: Label) -> Iterator[ModelProblem]:
    """Problems of candidate pairs without a pair function; one for each pair of shape types.

    Args:
      model: a `Model`, a `mujoco.MjModel`, or anything with their fields.
      rows: candidate pairs as `candidate_pairs` returns them.
      label: from (kind, id) to the name of an element in messages.
    """
    asked = np.column_stack([np.asarray(model.geom_type)[rows[:, :2]], rows[:, 2] >= 0])
    first = np.sort(np.unique(asked, axis=0, return_index=True)[1])
    for row, (*types, explicit) in zip(rows[first], asked[first].tolist(), strict=True):
        if tuple(types) not in PAIRS:
            yield ModelProblem(
                " and ".join(label("geom", int(geom)) for geom in row[:2]),
                f"{type_name(types[0])} and {type_name(types[1])} may collide, but the supported "
                f"pairs of shapes are {supported_pairs()}; {_REMEDIES[explicit]}",
            )


def dropped_pairs(model: Any, rows: np.ndarray, label: Label) -> str:
    """The candidate pairs without a pair function as text; empty if there are none."""
    rows = rows[~is_supported(model, rows)]
    pairs = [" and ".join(label("geom", int(geom)) for geom in row[:2]) for row in rows[:_NAMED]]
    more = [f"{len(rows) - _NAMED} more"] if len(rows) > _NAMED else []
    return ", ".join([*pairs, *more])
