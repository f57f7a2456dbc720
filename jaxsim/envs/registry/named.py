"""Objects by name: "module:name"."""

import functools
import importlib
from types import ModuleType
from typing import Any


def module_of(path: str) -> ModuleType:
    """The module of "module:name", imported.

    Raises:
      ImportError: the path has another form, or there is no such module.
    """
    place, _, name = path.partition(":")
    if not all(part.isidentifier() for part in (*place.split("."), *name.split("."))):
        raise ImportError(f"{path!r} is not of the form module:name")
    return importlib.import_module(place)


def named(path: str) -> Any:
    """The object "module:name"; imports the module.

    Args:
      path: for instance "my_package.tasks:Balance".

    Raises:
      ImportError: the path has another form, or there is no such module or name in it.
    """
    place, _, name = path.partition(":")
    try:
        return functools.reduce(getattr, name.split("."), module_of(path))
    except AttributeError as error:
        raise ImportError(f"there is no {name!r} in the module {place!r}") from error
