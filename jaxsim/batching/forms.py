"""Forms of equations with inner programs: what their parameters say, whatever JAX calls them.

The parameters are no public interface and their names move between releases (jax 0.12 renamed
those of `scan`). So each primitive is registered with a function that reads them, which detects
what it finds by its features, never by a version number. A form that it does not know reads as
None: `jax.vmap` of that primitive then takes over, and `warn_unknown` says so once.
"""

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax

from jaxsim.batching import registry


@dataclass(frozen=True)
class Program:
    """A traced function: equations, and the constants it closed over."""

    jaxpr: Any
    consts: tuple


@dataclass(frozen=True)
class Scan:
    """`lax.scan`: operands are constants, then carry, then scanned arrays."""

    body: Program
    num_consts: int
    num_carry: int
    options: dict


@dataclass(frozen=True)
class While:
    """`lax.while_loop`: operands are the condition's constants, the body's, then the carry."""

    cond: Program
    body: Program
    num_cond_consts: int
    num_body_consts: int


@dataclass(frozen=True)
class Cond:
    """`lax.cond` and `lax.switch`: operands are the branch index, then the branches' own.

    With platforms, the names for each branch or None for the default, it is
    `lax.platform_dependent`, and the index that of the platform.
    """

    branches: tuple[Program, ...]
    platforms: tuple[tuple[str, ...] | None, ...] | None


@dataclass(frozen=True)
class Jit:
    """A call of a jitted function, which may be inlined."""

    body: Program
    name: str


@dataclass(frozen=True)
class Remat:
    """`jax.checkpoint`, before or after its differentiation.

    Attributes:
      body: the program.
      prevent_cse: indices of operands behind a barrier, so that the backward pass computes anew
        what the forward pass has computed; none before differentiation.
    """

    body: Program
    prevent_cse: tuple[int, ...]


@dataclass(frozen=True)
class Custom:
    """A call of a function with a derivative of its own ("jvp" or "vjp")."""

    body: Program
    kind: str


@dataclass(frozen=True)
class LinearSolve:
    """`lax.custom_linear_solve`: operands are the constants of each program, then b.

    Attributes:
      parts: the programs by name; one that is missing has no constants and is None.
      counts: number of constants of each.
      replace: from new programs to the parameters of the primitive.
    """

    parts: dict[str, Program | None]
    counts: dict[str, int]
    replace: Callable[[dict], dict]


def program(jaxpr) -> Program:
    """Accept an open jaxpr, a closed one, or the one type that jax 0.12 has for both."""
    return Program(getattr(jaxpr, "jaxpr", jaxpr), tuple(getattr(jaxpr, "consts", ())))


def read(eqn):
    """The form of a higher-order equation, or None for an ordinary or an unknown one."""
    reader = registry.find(eqn).read
    if reader is None:
        return None
    try:
        return reader(eqn.params)
    except (KeyError, AttributeError, TypeError, ValueError, IndexError):
        warn_unknown(eqn.primitive.name)
        return None


@functools.cache
def warn_unknown(name: str) -> None:
    """Say, once for each primitive, that its parameters were not understood."""
    warnings.warn(
        f"jaxsim.vmap does not know how this JAX release ({jax.__version__}) stores {name}; "
        "it uses jax.vmap for it, which is slower",
        stacklevel=2,
    )


def platform_branch(form: Any, platform: str) -> Program | None:
    """The program that a `lax.platform_dependent` runs there; None for all other forms."""
    platforms = (form.platforms if isinstance(form, Cond) else None) or ()
    fitting = (i for i, names in enumerate(platforms) if names is None or platform in names)
    i = next(fitting, None)
    return None if i is None else form.branches[i]
