"""Settings of trainers: frozen dataclasses, filled from YAML files and from `key=value` pairs.

A key that does not exist is an error that names its neighbours, and a value of the wrong type is
an error that says what would work; nothing is ignored in silence.
"""

import dataclasses
import difflib
import pathlib
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import yaml

T = TypeVar("T")


class ConfigError(ValueError):
    """A setting that does not exist or has a value that makes no sense."""


@dataclasses.dataclass(frozen=True)
class NetworkConfig:
    """A multilayer perceptron.

    Attributes:
      hidden: units of the hidden layers.
      activation: tanh, relu, elu or swish.
    """

    hidden: tuple[int, ...] = (64, 64)
    activation: str = "tanh"


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """What all trainers have in common.

    Attributes:
      total_steps: environment steps of the whole training, in all environments together.
      envs: environments that are simulated at the same time, on all devices together.
      evaluations: how often the deterministic policy is evaluated, evenly spread; the last one
        is at the end.
      evaluation_episodes: episodes of one evaluation.
      evaluation_steps: longest episode of an evaluation, for tasks without a time limit.
      target: stop as soon as an evaluation returns at least this.
      env_options: options of the environment, as for `jaxsim.envs.make`.
    """

    total_steps: int = 1_000_000
    envs: int = 512
    evaluations: int = 10
    evaluation_episodes: int = 64
    evaluation_steps: int = 1000
    target: float | None = None
    env_options: dict = dataclasses.field(default_factory=dict)


def build(cls: type[T], values: Mapping[str, Any], where: str = "") -> T:
    """A dataclass from a (nested) mapping.

    Args:
      cls: the dataclass; fields that are dataclasses take mappings.
      values: new values; whatever is missing has its default.
      where: name of the settings in error messages.

    Returns:
      The filled record.

    Raises:
      ConfigError: a key does not exist, or a value does not fit its type.
    """
    return update(cls(), values, where)


def update(config: T, values: Mapping[str, Any], where: str = "") -> T:
    """A copy of `config` with some values replaced; arguments and errors as for `build`."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where or 'the settings'} must be a mapping, got {values!r}")
    kinds = typing.get_type_hints(type(config))
    changes = {}
    for key, value in values.items():
        path = f"{where}.{key}" if where else str(key)
        if key not in kinds:
            raise ConfigError(unknown("setting", path, str(key), kinds))
        current = getattr(config, key)
        nested = dataclasses.is_dataclass(current)
        changes[key] = update(current, value, path) if nested else _fit(kinds[key], value, path)
    return dataclasses.replace(config, **changes)  # type: ignore[type-var]


def override(config: T, assignments: Iterable[str]) -> T:
    """Apply assignments such as `network.hidden=[128,128]`; values are YAML.

    Raises:
      ConfigError: as `build`, or an assignment without "=".
    """
    for text in assignments:
        path, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"expected key=value, got {text!r}")
        values: Any = yaml.safe_load(value)
        for key in reversed(path.strip().split(".")):
            values = {key: values}
        config = update(config, values)
    return config


def read(path: pathlib.Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
      ConfigError: the file is missing or is no YAML mapping.
    """
    try:
        values = yaml.safe_load(path.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must contain a mapping of settings, got {values!r}")
    return values


def find(algorithm: str, env: str) -> pathlib.Path | None:
    """The tuned settings that come with jaxsim, if there are any.

    They are `configs/<algorithm>/<env>.yaml`, beside the package in a clone of the repository and
    inside it when installed from a wheel.
    """
    package = pathlib.Path(__file__).parent.parent
    for root in (package.parent / "configs", package / "configs"):
        path = root / algorithm / f"{env}.yaml"
        if path.is_file():
            return path
    return None


def plain(config: Any) -> Any:
    """Settings as what YAML can say; `build` reads it back."""
    if dataclasses.is_dataclass(config) and not isinstance(config, type):
        fields = dataclasses.fields(config)
        return {field.name: plain(getattr(config, field.name)) for field in fields}
    return list(config) if isinstance(config, tuple) else config


def unknown(kind: str, path: str, key: str, known: Iterable[str]) -> str:
    """The message for a name that does not exist, with those it may have meant."""
    known = sorted(known)
    near = difflib.get_close_matches(key, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known)}"
    return f"unknown {kind} {path!r}; {hint}"


def _fit(kind: Any, value: Any, path: str) -> Any:
    """The value as the type of its field."""
    origin = typing.get_origin(kind)
    if origin in (types.UnionType, typing.Union):
        options = typing.get_args(kind)
        if value is None and type(None) in options:
            return None
        return _fit(next(k for k in options if k is not type(None)), value, path)
    if origin is tuple:
        items = value if isinstance(value, list | tuple) else [value]
        return tuple(_fit(typing.get_args(kind)[0], item, path) for item in items)
    if kind in (int, float):
        return _number(kind, value, path)
    if not isinstance(value, kind):
        raise ConfigError(f"{path} must be of type {kind.__name__}, got {value!r}")
    return value


def _number(kind: type, value: Any, path: str) -> int | float:
    """YAML reads 1e6 as text and 1.0e6 as a float; both are welcome as integers."""
    try:
        number = float("nan") if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if number != number or (kind is int and number != int(number)):
        raise ConfigError(f"{path} must be of type {kind.__name__}, got {value!r}")
    return kind(number) if kind is float or not isinstance(value, int) else value
