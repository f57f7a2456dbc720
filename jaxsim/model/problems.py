"""What is wrong with a model, as a list of sentences."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxsim.model.errors import ModelError

_NAMED = 3  # so many elements with the same problem are named


class Problem(NamedTuple):
    """An element of the model, or "" for the whole of it, and what is wrong with it."""

    who: str
    what: str


def rows(wrong: np.ndarray) -> list[int]:
    """Which entries of a field are wrong, in any of their numbers."""
    return np.nonzero(wrong.any(axis=tuple(range(1, wrong.ndim))))[0].tolist()


def raise_problems(problems: Iterable[Problem]) -> None:
    """Raise one `ModelError` if there are any; those that differ in the element only are one."""
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
