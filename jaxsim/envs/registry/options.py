"""Options of environments: the fields of their classes, checked before anything is traced."""

import dataclasses
import difflib
import typing
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import numpy as np

from jaxsim.model import Model

_NUMBER = (int, float, np.number, np.ndarray, jax.Array)


def checked_options(name: str, cls: type, options: dict[str, Any]) -> dict[str, Any]:
    """Check the options of an environment, and convert lists to tuples.

    Args:
      name: name of the environment in error messages.
      cls: its class, a record.
      options: values by the names of its fields.

    Raises:
      TypeError: some options are invalid; the message lists all of them.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}
    problems, checked = [], {}
    for option, value in options.items():
        if option not in fields:
            problems.append(f"{name} has no option {option!r}; {near_names(option, fields)}")
            continue
        if isinstance(value, list):
            value = tuple(value)
        wanted = _wanted(fields[option], value)
        if wanted:
            problems.append(f"the option {option!r} of {name} must be {wanted}, got {value!r:.200}")
        checked[option] = value
    if problems:
        raise TypeError("; ".join(problems))
    return checked


def near_names(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: similar names, or all of them."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=3)
    return f"did you mean {' or '.join(near)}?" if near else f"choose from {', '.join(known)}"


def _wanted(field: dataclasses.Field, value: Any) -> str | None:
    """The type that a field expects, if the value is of another type; else None."""
    kinds = typing.get_args(field.type) or (field.type,)
    default = field.default
    if Model in kinds:
        return None if isinstance(value, Model) else "a model, as from jaxsim.load"
    if field.name == "frame_skip":
        return None if _whole(value) and value > 0 else "a positive whole number"
    if isinstance(default, bool):
        return None if isinstance(value, bool | np.bool_) else "true or false"
    if not field.metadata.get("pytree_node", True):
        right = (int in kinds and _whole(value)) or (str in kinds and isinstance(value, str))
        return "a whole number" if isinstance(default, int) and not right else None
    if isinstance(default, int | float):
        return None if _real(value) else "a number"
    if isinstance(default, tuple) and all(map(_real, default)):
        return None if _reals(value, len(default)) else f"{len(default)} numbers"
    return None


def _whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _real(value: Any) -> bool:
    """Whether this is a number or an array of numbers, without NaN."""
    real = isinstance(value, _NUMBER) and not isinstance(value, bool)
    return real and not (isinstance(value, float) and value != value)


def _reals(value: Any, count: int) -> bool:
    if isinstance(value, np.ndarray | jax.Array):
        return value.shape == (count,)
    return isinstance(value, Sequence) and len(value) == count and all(map(_real, value))
