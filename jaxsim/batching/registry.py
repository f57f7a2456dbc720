"""Properties of primitives, registered once for each in the file with its rule.

A primitive that is not registered is batched by `jax.vmap`, its inner programs are not read, and it
is not part of a section. This is slower, but correct.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

Rule = Callable[[Any, Any, list, list[bool]], Sequence | None]
"""From `Lanes`, an equation, its operands and which of them are batched to its results.

These are all batched, with the lanes as their last axis. None means "not this form of the
primitive", which `jax.vmap` then takes over.
"""


@dataclasses.dataclass(frozen=True)
class Primitive:
    """The properties of one primitive.

    Attributes:
      rule: evaluates an equation on arrays whose last axis is the batch.
      read: for a primitive with inner programs, from its parameters to one of `forms`.
      bodies: name of the parameter with programs that are divided into sections.
      in_section: whether XLA can compile the primitive within a section.
      takes: kinds of `Lazy` operands that the rule accepts.
      uniform: whether its results are the same for all lanes, whatever its operands.
    """

    rule: Rule | None = None
    read: Callable[[dict], Any] | None = None
    bodies: str | None = None
    in_section: bool | Callable[[Any], bool] = False
    takes: tuple[type, ...] = ()
    uniform: bool = False


_UNKNOWN = Primitive()
_PRIMITIVES: dict[str, Primitive] = {}


def register(*names: str, **known) -> None:
    """Register primitives by name, because only names are the same in all releases of JAX.

    Args:
      *names: one or several primitives with the same properties.
      **known: attributes of `Primitive`.

    Raises:
      ValueError: one of them is registered already.
    """
    for name in names:
        if name in _PRIMITIVES:
            raise ValueError(f"the primitive {name!r} is registered twice")
        _PRIMITIVES[name] = Primitive(**known)


def find(eqn) -> Primitive:
    """The properties of an equation's primitive."""
    return _PRIMITIVES.get(eqn.primitive.name, _UNKNOWN)


def fits_section(eqn) -> bool:
    """Whether XLA can compile this equation within a section, apart from its inner programs."""
    fits = find(eqn).in_section
    return fits(eqn) if callable(fits) else fits
