"""Environments by name."""

import dataclasses
from collections.abc import Callable
from typing import Any

from jaxsim.envs.base.env import Env
from jaxsim.envs.registry.named import module_of, named
from jaxsim.envs.registry.options import checked_options, near_names
from jaxsim.envs.wrappers import TimeLimit


@dataclasses.dataclass(frozen=True)
class Spec:
    """An entry of the registry.

    Attributes:
      name: name for `make`.
      cls: the class, or "module:class" until it is needed.
      max_episode_steps: default length of an episode; None for no limit.
    """

    name: str
    cls: type | str
    max_episode_steps: int | None

    def load(self) -> type:
        """The class; imports its module."""
        return self.cls if isinstance(self.cls, type) else named(self.cls)


_BUILT_IN = {
    "acrobot": ("Acrobot", 1000),
    "ant": ("Ant", 1000),
    "cartpole": ("Cartpole", 1000),
    "fast": ("Fast", 20),
    "half_cheetah": ("HalfCheetah", 1000),
    "hopper": ("Hopper", 1000),
    "humanoid": ("Humanoid", 1000),
    "humanoid_standup": ("HumanoidStandup", 1000),
    "inverted_double_pendulum": ("InvertedDoublePendulum", 1000),
    "inverted_pendulum": ("InvertedPendulum", 1000),
    "pendulum": ("Pendulum", 200),
    "quadruped": ("Quadruped", 1000),
    "reacher": ("Reacher", 50),
    "swimmer": ("Swimmer", 1000),
    "walker2d": ("Walker2d", 1000),
}
_SPECS = {
    name: Spec(name, f"jaxsim.envs.{name}:{cls}", steps) for name, (cls, steps) in _BUILT_IN.items()
}
_LISTENERS: list[Callable[[str], object]] = []
_DEFAULT = object()
_USUAL_STEPS = 1000


def names() -> tuple[str, ...]:
    """Names of all registered environments, in alphabetical order."""
    return tuple(sorted(_SPECS))


def spec(name: str) -> Spec:
    """The entry of an environment.

    Args:
      name: one of `names()`; or "module:Class" or "module:name", which imports the module first.

    Raises:
      KeyError: no environment has this name.
    """
    if ":" in name:
        return _of_module(name)
    if name not in _SPECS:
        raise KeyError(f"there is no environment called {name!r}; {near_names(name, names())}")
    return _SPECS[name]


def _of_module(path: str) -> Spec:
    """A class in a module, or what is registered under a name once the module is imported."""
    name = path.partition(":")[2]
    try:
        found = getattr(module_of(path), name, None)
        if name in _SPECS and not isinstance(found, type):
            return _SPECS[name]
        cls = _checked_class(named(path))
    except ImportError as error:
        raise KeyError(f"there is no environment {path!r}: {error}") from error
    same = [entry for entry in _SPECS.values() if entry.cls in (cls, path)]
    return same[0] if same else Spec(path, cls, _USUAL_STEPS)


def register(name: str, cls: type, max_episode_steps: int | None = _USUAL_STEPS) -> None:
    """Register your own environment for `make` and the command line.

    Args:
      name: a new name.
      cls: a flax record that derives from `Task` or `Env`; its fields become options of `make`.
      max_episode_steps: default length of an episode; None for no limit.

    Raises:
      TypeError: the class is not an environment, or not a record.
      ValueError: the name is taken by another class, or the length is not positive.
    """
    if name in _SPECS and _SPECS[name].load() is not cls:
        raise ValueError(f"there is an environment called {name!r} already; choose another name")
    _SPECS[name] = Spec(name, _checked_class(cls), _checked_limit(max_episode_steps))
    for listener in _LISTENERS:
        listener(name)


def _checked_class(cls: Any) -> type[Env]:
    if not (isinstance(cls, type) and issubclass(cls, Env)):
        raise TypeError(f"a task is a class that derives from jaxsim.envs.Task, got {cls!r}")
    if "__dataclass_fields__" not in cls.__dict__:
        raise TypeError(f"decorate {cls.__name__} with @flax.struct.dataclass(kw_only=True)")
    return cls


def _checked_limit(steps: Any) -> int | None:
    if steps is None or (isinstance(steps, int) and not isinstance(steps, bool) and steps > 0):
        return steps
    raise ValueError(f"max_episode_steps must be a positive whole number or None, got {steps!r}")


def on_register(listener: Callable[[str], object]) -> None:
    """Call a function with the name of every environment, registered now or later."""
    _LISTENERS.append(listener)
    for name in names():
        listener(name)


def make(name: str, *, max_episode_steps: int | object | None = _DEFAULT, **options) -> Env:
    """Make an environment.

    Args:
      name: one of `names()`; or "module:Class", or "module:name" of what the module registers.
      max_episode_steps: length of an episode; None for no limit; by default the registered one.
      options: fields of the environment's class, for instance `reset_noise_scale` or `model`.

    Raises:
      KeyError: no environment has this name.
      TypeError: the environment has no such option, or its value is of the wrong kind.
      ValueError: the length is not positive.
    """
    entry = spec(name)
    cls = entry.load()
    env = cls(**checked_options(name, cls, options))
    chosen = entry.max_episode_steps if max_episode_steps is _DEFAULT else max_episode_steps
    limit = _checked_limit(chosen)
    return env if limit is None else TimeLimit(env, max_episode_steps=limit)
