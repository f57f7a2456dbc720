"""Conversion of values from YAML or Python to the annotated types of settings.

A range is part of the type, `Annotated[float, Range(0, 1)]`; a choice of words is a `Literal`.
"""

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from jaxsim.rl.errors import ConfigError


@dataclasses.dataclass(frozen=True)
class Range:
    """An interval of numbers.

    Attributes:
      low: lower limit.
      high: upper limit.
      open: limits that are excluded, any of "low" and "high".
    """

    low: float = -math.inf
    high: float = math.inf
    open: tuple[str, ...] = ()

    def __contains__(self, x: float) -> bool:
        """Whether a number is in the range."""
        above = x > self.low if "low" in self.open else x >= self.low
        below = x < self.high if "high" in self.open else x <= self.high
        return above and below

    def __str__(self) -> str:
        """The range in words."""
        words = []
        if math.isfinite(self.low):
            words.append(f"{'more than' if 'low' in self.open else 'at least'} {self.low:.16g}")
        if math.isfinite(self.high):
            words.append(f"{'less than' if 'high' in self.open else 'at most'} {self.high:.16g}")
        return " and ".join(words)


Count = Annotated[int, Range(1, 2**31 - 1)]  # fits the integers of a compiled program
Seed = Annotated[int, Range(-(2**31), 2**31 - 1)]
Steps = Annotated[int, Range(1, 10**15)]
Positive = Annotated[float, Range(0, open=("low",))]
NotNegative = Annotated[float, Range(0)]
Fraction = Annotated[float, Range(0, 1)]
Average = Annotated[float, Range(0, 1, open=("high",))]  # factor of the past in a running mean
Activation = Literal["tanh", "relu", "elu", "swish"]

_WORDS = {bool: "true or false", str: "a word", dict: "a mapping"}


def fit(kind: Any, value: Any, path: str) -> Any:
    """Convert a value to the type of its setting.

    Args:
      kind: the annotation: bool, int, float, str, dict, a `Literal`, an `Annotated` number, a
        tuple, a record, or one of these or None.
      value: the given value.
      path: name of the setting in error messages.

    Raises:
      ConfigError: it is of another type, or out of range.
    """
    origin, options = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in options:
            return None
        return fit(next(k for k in options if k is not type(None)), value, path)
    if origin is Annotated:
        return _ranged(options, value, path)
    if origin is Literal:
        return _chosen(options, value, path)
    if origin is tuple:
        return _items(options, value, path)
    if kind in (int, float):
        return _number(kind, value, path)
    if not isinstance(value, kind):
        raise ConfigError(f"{path} must be {_WORDS.get(kind, kind.__name__)}, got {value!r}")
    return dict(value) if isinstance(value, Mapping) else value


def _ranged(options, value, path: str):
    number, (allowed,) = fit(options[0], value, path), options[1:]
    if number not in allowed:
        raise ConfigError(f"{path} must be {allowed}, got {value!r}")
    return number


def _chosen(options, value, path: str):
    if value not in options:
        words = f"{', '.join(options[:-1])} or {options[-1]}"
        raise ConfigError(f"{path} must be {words}, got {value!r}")
    return value


def _items(options, value, path: str):
    """A tuple of any length, `tuple[X, ...]`, or of a fixed one, `tuple[X, X]`."""
    items = value if isinstance(value, list | tuple) else [value]
    kinds = [options[0]] * len(items) if options[-1] is ... else options
    if len(items) != len(kinds):
        raise ConfigError(f"{path} must be {len(kinds)} values, got {value!r}")
    return tuple(fit(k, item, path) for k, item in zip(kinds, items, strict=True))


def _number(kind: type, value: Any, path: str) -> int | float:
    """A finite number. YAML reads 1e6 as text and 1.0e6 as a float; both may be integers."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number) or (kind is int and number != int(number)):
        name = "whole number" if kind is int else "finite number"
        raise ConfigError(f"{path} must be a {name}, got {value!r}")
    return kind(number) if kind is float or not isinstance(value, int) else value
