"""Environments by name."""

import dataclasses
import difflib
import importlib
from collections.abc import Callable

from jaxsim.envs.base import Env
from jaxsim.envs.wrappers import TimeLimit


@dataclasses.dataclass(frozen=True)
class Spec:
    """An entry of the registry.

    Attributes:
      name: what `make` is called with.
      cls: the class, or "module:class" until it is needed.
      max_episode_steps: the usual length of an episode; None for no limit.
    """

    name: str
    cls: type | str
    max_episode_steps: int | None

    def load(self) -> type:
        """The class; imports its module."""
        if isinstance(self.cls, type):
            return self.cls
        module, name = self.cls.split(":")
        return getattr(importlib.import_module(module), name)


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


def names() -> tuple[str, ...]:
    """Names of all registered environments, in alphabetical order."""
    return tuple(sorted(_SPECS))


def spec(name: str) -> Spec:
    """The entry of an environment.

    Raises:
      KeyError: no environment has this name.
    """
    if name not in _SPECS:
        raise KeyError(f"there is no environment called {name!r}; {_hint(name, names())}")
    return _SPECS[name]


def register(name: str, cls: type, max_episode_steps: int | None = 1000) -> None:
    """Make an environment of one's own available to `make` and to the command line.

    Args:
      name: a new name.
      cls: a flax record that derives from `Task` or `Env`; its fields become options of `make`.
      max_episode_steps: the usual length of an episode; None for no limit.

    Raises:
      TypeError: the class is not an environment, or not a record.
      ValueError: the name is taken by another class.
    """
    if not (isinstance(cls, type) and issubclass(cls, Env)):
        raise TypeError(f"register takes a class that derives from jaxsim.envs.Task, got {cls!r}")
    if "__dataclass_fields__" not in cls.__dict__:
        raise TypeError(f"decorate {cls.__name__} with @flax.struct.dataclass(kw_only=True)")
    if name in _SPECS and _SPECS[name].load() is not cls:
        raise ValueError(f"there is an environment called {name!r} already; choose another name")
    _SPECS[name] = Spec(name, cls, max_episode_steps)
    for listener in _LISTENERS:
        listener(name)


def on_register(listener: Callable[[str], object]) -> None:
    """Call a function with the name of every environment: those there are and those to come."""
    _LISTENERS.append(listener)
    for name in names():
        listener(name)


def make(name: str, *, max_episode_steps: int | object | None = _DEFAULT, **options) -> Env:
    """Make an environment.

    Args:
      name: one of `names()`.
      max_episode_steps: length of an episode; None for no limit; by default the registered one.
      options: fields of the environment's class, for instance `reset_noise_scale` or `model`.

    Raises:
      KeyError: no environment has this name.
      TypeError: the environment has no such option.
      ValueError: the length is not positive.
    """
    entry = spec(name)
    cls = entry.load()
    known = [f.name for f in dataclasses.fields(cls)]
    for option in options:
        if option not in known:
            raise TypeError(f"{name} has no option {option!r}; {_hint(option, known)}")
    env = cls(**options)
    limit = entry.max_episode_steps if max_episode_steps is _DEFAULT else max_episode_steps
    if limit is None:
        return env
    if not isinstance(limit, int) or limit < 1:
        raise ValueError(f"max_episode_steps must be a positive whole number or None, got {limit}")
    return TimeLimit(env, max_episode_steps=limit)


def _hint(name: str, known) -> str:
    near = difflib.get_close_matches(name, known, n=3)
    return f"did you mean {' or '.join(near)}?" if near else f"choose from {', '.join(known)}"
