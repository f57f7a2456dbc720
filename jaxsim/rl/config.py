"""Settings of trainers: frozen dataclasses, filled from YAML files and from `key=value` pairs.

A record of settings checks itself when it is made. A key that does not exist is an error that
names its neighbours, a value that makes no sense one that says what would; all of them are told at
once, and nothing is ignored in silence.
"""

import dataclasses
import difflib
import functools
import importlib.resources
import pathlib
import re
import typing
from collections.abc import Iterable, Mapping
from importlib.resources.abc import Traversable
from typing import Any, TypeVar

import yaml

from jaxsim.rl.errors import ConfigError
from jaxsim.rl.values import Activation, Count, Steps, fit

T = TypeVar("T")


class _Loader(yaml.SafeLoader):
    """Plain YAML, in which 1e6 is a number; its version 1.1 takes it for text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


@dataclasses.dataclass(frozen=True)
class Settings:
    """A record whose values are checked against the types of their fields, ranges included."""

    def __post_init__(self) -> None:
        """Check all values; numbers become those of their types.

        Raises:
          ConfigError: some make no sense.
        """
        given = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        for name, value in _fitted(type(self), given, "").items():
            object.__setattr__(self, name, value)


@dataclasses.dataclass(frozen=True)
class NetworkConfig(Settings):
    """A multilayer perceptron.

    Attributes:
      hidden: units of the hidden layers.
      activation: tanh, relu, elu or swish.
    """

    hidden: tuple[Count, ...] = (64, 64)
    activation: Activation = "tanh"


@dataclasses.dataclass(frozen=True)
class TrainConfig(Settings):
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

    total_steps: Steps = 1_000_000
    envs: Count = 512
    evaluations: Count = 10
    evaluation_episodes: Count = 64
    evaluation_steps: Count = 1000
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
    return dataclasses.replace(config, **_fitted(type(config), values, where, config))  # type: ignore[type-var]


def override(config: T, assignments: Iterable[str]) -> T:
    """Apply assignments such as `network.hidden=[128,128]`; values are YAML.

    Raises:
      ConfigError: as `build`, or an assignment cannot be read.
    """
    values: dict[str, Any] = plain(config)
    problems: list[str] = []
    for text in assignments:
        path, equals, value = text.partition("=")
        try:
            parsed = yaml.load(value, _Loader)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            problems.append(f"cannot read the value in {text!r}: {_one_line(error)}")
            continue
        if not equals:
            problems.append(f"expected key=value, got {text!r}")
            continue
        _assign(values, path.strip().split("."), parsed)
    try:
        config = build(type(config), values)
    except ConfigError as error:
        problems += error.problems
    if problems:
        raise ConfigError(*problems)
    return config


def _assign(tree: dict[str, Any], path: list[str], value: Any) -> None:
    """Set an entry of nested mappings; what is in the way, and is none, gives way."""
    *folders, last = path
    for name in folders:
        if not isinstance(tree.get(name), dict):
            tree[name] = {}
        tree = tree[name]
    tree[last] = value


def read(path: pathlib.Path | Traversable) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
      ConfigError: the file is missing or is no YAML mapping.
    """
    try:
        values = yaml.load(path.read_text("utf-8"), _Loader)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is not valid YAML: {_one_line(error)}") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must contain a mapping of settings, got {values!r}")
    return values


def find(algorithm: str, env: str) -> Traversable | None:
    """The tuned settings that come with jaxsim, if there are any.

    They are `configs/<algorithm>/<env>.yaml`, inside the package when it was installed from a
    wheel and beside it in a clone of the repository.
    """
    package = importlib.resources.files("jaxsim")
    folders = [package / "configs"]
    # What else lies beside an installed package is not ours.
    if isinstance(package, pathlib.Path) and (package.parent / "pyproject.toml").is_file():
        folders.append(package.parent / "configs")
    files = (folder / algorithm / f"{env}.yaml" for folder in folders)
    return next((file for file in files if file.is_file()), None)


def plain(config: Any) -> Any:
    """Settings as what YAML can say; `build` reads it back."""
    if dataclasses.is_dataclass(config) and not isinstance(config, type):
        fields = dataclasses.fields(config)
        return {field.name: plain(getattr(config, field.name)) for field in fields}
    if isinstance(config, dict):
        return {name: plain(value) for name, value in config.items()}
    return [plain(value) for value in config] if isinstance(config, tuple) else config


def unknown(kind: str, path: str, key: str, known: Iterable[str]) -> str:
    """The message for a name that does not exist, with those it may have meant."""
    known = sorted(known)
    near = difflib.get_close_matches(key, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known)}"
    return f"unknown {kind} {path!r}; {hint}"


@functools.cache
def _kinds(cls: type) -> dict[str, Any]:
    """The types of a record's fields, with their ranges."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


def _fitted(cls: type, values: Mapping[str, Any], where: str, now: Any = None) -> dict[str, Any]:
    """Values as the types of their fields.

    Args:
      cls: the record.
      values: what is to be in it; records in it may be mappings.
      where: name of the record in error messages.
      now: where a nested mapping takes its missing values from.

    Raises:
      ConfigError: everything that is wrong.
    """
    kinds, fitted, problems = _kinds(cls), {}, []
    for key, value in values.items():
        path = f"{where}.{key}" if where else str(key)
        try:
            if key not in kinds:
                raise ConfigError(unknown("setting", path, str(key), kinds))
            nested = now is not None and dataclasses.is_dataclass(kinds[key])
            if nested and not dataclasses.is_dataclass(value):
                fitted[key] = update(getattr(now, key), value, path)
            else:
                fitted[key] = fit(kinds[key], value, path)
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(*problems)
    return fitted


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
