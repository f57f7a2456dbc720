"""Candidate pairs of geoms whose shapes no function handles."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxsim.collision.table import PAIRS, supported_pairs, type_name
from jaxsim.model.names import Label
from jaxsim.model.problems import Problem

_NAMED = 10  # so many pairs are named
# No filter applies to an explicit <pair>.
_REMEDIES = (
    "set contype and conaffinity to 0 on one of them or add an <exclude> for their bodies",
    "remove their <pair>",
)


def is_supported(model: Any, rows: np.ndarray) -> np.ndarray:
    """Whether a function handles the shapes of candidate pairs, (n,)."""
    types = np.asarray(model.geom_type)[rows[:, :2]].tolist()
    return np.array([tuple(pair) in PAIRS for pair in types], bool)


def unsupported_pairs(model: Any, rows: np.ndarray, label: Label) -> Iterator[Problem]:
    """What is wrong with candidate pairs, and what to do; one for each two shapes.

    Args:
      model: a `Model`, a `mujoco.MjModel`, or anything with their fields.
      rows: candidate pairs as `candidate_pairs` gives them.
      label: how a message refers to a geom.
    """
    asked = np.column_stack([np.asarray(model.geom_type)[rows[:, :2]], rows[:, 2] >= 0])
    first = np.sort(np.unique(asked, axis=0, return_index=True)[1])
    for row, (*types, explicit) in zip(rows[first], asked[first].tolist(), strict=True):
        if tuple(types) not in PAIRS:
            yield Problem(
                " and ".join(label("geom", int(geom)) for geom in row[:2]),
                f"{type_name(types[0])} and {type_name(types[1])} may collide, but the supported "
                f"pairs of shapes are {supported_pairs()}; {_REMEDIES[explicit]}",
            )


def dropped_pairs(model: Any, rows: np.ndarray, label: Label) -> str:
    """Which candidate pairs are left out, in words; empty if none is."""
    rows = rows[~is_supported(model, rows)]
    pairs = [" and ".join(label("geom", int(geom)) for geom in row[:2]) for row in rows[:_NAMED]]
    more = [f"{len(rows) - _NAMED} more"] if len(rows) > _NAMED else []
    return ", ".join([*pairs, *more])
