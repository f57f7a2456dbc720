"""What the interpreter and the sections know of a primitive, registered once, beside its rule.

A primitive that is not registered is batched by `jax.vmap`, has no inner programs that are read,
and is part of no section: slower, and just as right.
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
    """All that is known of one primitive.

    Attributes:
      rule: how it acts on arrays whose last axis is the batch.
      read: for a primitive with inner programs: from its parameters to one of `forms`.
      bodies: the parameter with programs that are divided into sections of their own.
      in_section: whether XLA compiles an equation of it within a section.
      takes: kinds of `Lazy` operands that the rule takes as they are.
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
    """Register primitives by name, which is all that stays the same between releases of JAX.

    Args:
      *names: the primitive, or several of which the same is known.
      **known: the attributes of `Primitive`.

    Raises:
      ValueError: one of them is registered already.
    """
    for name in names:
        if name in _PRIMITIVES:
            raise ValueError(f"the primitive {name!r} is registered twice")
        _PRIMITIVES[name] = Primitive(**known)


def find(eqn) -> Primitive:
    """What is known of an equation's primitive."""
    return _PRIMITIVES.get(eqn.primitive.name, _UNKNOWN)


def fits_section(eqn) -> bool:
    """Whether XLA compiles this equation within a section, its inner programs aside."""
    fits = find(eqn).in_section
    return fits(eqn) if callable(fits) else fits
