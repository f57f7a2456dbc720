"""Forms: the parameters of equations with inner programs, independent of JAX's release.

These parameters are not a public interface, and their names change between releases (jax 0.12
renamed those of `scan`). So each primitive is registered with a function that reads them. It tests
for features, not for version numbers, and returns None for parameters that it does not know. The
primitive is then batched by `jax.vmap`, and `warn_unknown` warns once.
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
    """`lax.cond` and `lax.switch`: operands are the branch index, then those of the branches.

    For `lax.platform_dependent`, `platforms` has the platforms' names for each branch, or None for
    the default branch, and the index is that of the platform.
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
      prevent_cse: indices of operands that need a barrier, so that the backward pass recomputes
        the values of the forward pass; none before differentiation.
    """

    body: Program
    prevent_cse: tuple[int, ...]


@dataclass(frozen=True)
class Custom:
    """A call of a function with a custom derivative ("jvp" or "vjp")."""

    body: Program
    kind: str


@dataclass(frozen=True)
class LinearSolve:
    """`lax.custom_linear_solve`: operands are the constants of each program, then b.

    Attributes:
      parts: the programs by name; None for one that does not exist.
      counts: number of constants of each program.
      replace: from new programs to the parameters of the primitive.
    """

    parts: dict[str, Program | None]
    counts: dict[str, int]
    replace: Callable[[dict], dict]


def program(jaxpr) -> Program:
    """A `Program` from an open or a closed jaxpr; jax 0.12 has one type for both."""
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
    """Warn, once for each primitive, that its parameters are not known."""
    warnings.warn(
        f"jaxsim.vmap does not know how this JAX release ({jax.__version__}) stores {name}; "
        "it uses jax.vmap for it, which is slower",
        stacklevel=2,
    )


def platform_branch(form: Any, platform: str) -> Program | None:
    """The branch of a `lax.platform_dependent` for a platform; None for all other forms."""
    platforms = (form.platforms if isinstance(form, Cond) else None) or ()
    fitting = (i for i, names in enumerate(platforms) if names is None or platform in names)
    i = next(fitting, None)
    return None if i is None else form.branches[i]
