"""Settings of trainers: frozen dataclasses, filled from YAML files and from `key=value` pairs.

A record of settings is checked when it is made. An unknown key is an error that lists similar keys,
and an invalid value is an error that says which values are valid. All errors are reported at once.
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
    """A YAML loader that reads 1e6 as a number, not as text as in YAML 1.1."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


@dataclasses.dataclass(frozen=True)
class Settings:
    """A record whose values are checked against the types of their fields, ranges included."""

    def __post_init__(self) -> None:
        """Check all values, and convert numbers to the types of their fields.

        Raises:
          ConfigError: some values are invalid.
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
    """Settings that all trainers share.

    Attributes:
      total_steps: environment steps of the whole training, in all environments together.
      envs: number of environments that are simulated in parallel, on all devices together.
      evaluations: number of evaluations of the deterministic policy, evenly spaced; the last one
        is at the end.
      evaluation_episodes: number of episodes of one evaluation.
      evaluation_steps: longest episode of an evaluation, for tasks without a time limit.
      target: mean return of an evaluation at which training stops; None for no target.
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
    """Set an entry of nested mappings; values on the path that are no mappings are replaced."""
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


def for_device(values: Mapping[str, Any], platform: str) -> dict[str, Any]:
    """Settings for a platform: on a GPU, those under `gpu` take the place of others.

    A GPU steps thousands of environments as fast as a few, and takes as long for a small gradient
    step as for a large one.

    Raises:
      ConfigError: what is under `gpu` is no mapping.
    """
    values = dict(values)
    there = values.pop("gpu", {})
    if not isinstance(there, Mapping):
        raise ConfigError(f"gpu must be a mapping of settings, got {there!r}")
    return {**values, **there} if platform == "gpu" else values


def find(algorithm: str, env: str) -> Traversable | None:
    """Path of the tuned settings that come with jaxsim, if there are any.

    It is `configs/<algorithm>/<env>.yaml`, inside the package if it was installed from a wheel, or
    next to it in a clone of the repository.
    """
    package = importlib.resources.files("jaxsim")
    folders = [package / "configs"]
    # What else lies beside an installed package is not ours.
    if isinstance(package, pathlib.Path) and (package.parent / "pyproject.toml").is_file():
        folders.append(package.parent / "configs")
    files = (folder / algorithm / f"{env}.yaml" for folder in folders)
    return next((file for file in files if file.is_file()), None)


def plain(config: Any) -> Any:
    """Settings as values that YAML can represent, from which `build` makes the same record."""
    if dataclasses.is_dataclass(config) and not isinstance(config, type):
        fields = dataclasses.fields(config)
        return {field.name: plain(getattr(config, field.name)) for field in fields}
    if isinstance(config, dict):
        return {name: plain(value) for name, value in config.items()}
    return [plain(value) for value in config] if isinstance(config, tuple) else config


def unknown(kind: str, path: str, key: str, known: Iterable[str]) -> str:
    """The message for an unknown name, with similar names."""
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
    """The values converted to the types of their fields.

    Args:
      cls: class of the record.
      values: values of its fields; records may be given as mappings.
      where: name of the record in error messages.
      now: record that supplies the missing values of nested mappings.

    Raises:
      ConfigError: some values are invalid; it lists all of them.
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
