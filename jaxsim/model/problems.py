"""Problems of a model, and the `ModelError` that lists them."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxsim.model.errors import ModelError

_NAMED = 3  # most elements with the same problem that a message names


class ModelProblem(NamedTuple):
    """One problem: `who` is the label of an element, or "" for the whole model."""

    who: str
    what: str


def rows(wrong: np.ndarray) -> list[int]:
    """Rows of a boolean array that are true anywhere."""
    return np.nonzero(wrong.any(axis=tuple(range(1, wrong.ndim))))[0].tolist()


def raise_problems(problems: Iterable[ModelProblem]) -> None:
    """Raise a `ModelError` if there are problems; equal problems of several elements are merged."""
    elements: dict[str, list[str]] = {}
    for problem in problems:
        elements.setdefault(problem.what, []).append(problem.who)
    if elements:
        raise ModelError(*(_sentence(who, what) for what, who in elements.items()))


def _sentence(who: list[str], what: str) -> str:
    named = [w for w in who[:_NAMED] if w]
    more = [f"{len(who) - _NAMED} more"] if len(who) > _NAMED else []
    named = [*named, *more]
    whose = " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)
    return f"{whose}: {what}" if whose else what
