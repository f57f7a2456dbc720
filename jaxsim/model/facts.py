"""Facts: static properties of a model, computed once and cached in its structure.

A fact depends on the structure, which never changes, and possibly on the numbers in some leaves.
Leaves may be replaced, mapped and differentiated, so the cache is keyed by their present numbers.
While one of the leaves is traced, for example as an argument of a jitted function, its numbers are
not known, and the fact has a conservative value that is right for all numbers. So a fact is never
out of date, and never hides a dependence from differentiation.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

T = TypeVar("T")


class Fact(Generic[T]):
    """A cached function of a model's structure and of some of its leaves.

    Attributes:
      compute: function of a model and of the numbers in the leaves as NumPy arrays. From the model
        it reads only the structure and `opt.disableflags`.
      leaves: names of these leaves.
      unknown: the value where one of the leaves is traced.
    """

    def __init__(self, compute: Callable[..., T], leaves: tuple[str, ...], unknown: Any):
        self.compute, self.leaves, self.unknown = compute, leaves, unknown
        functools.update_wrapper(self, compute)

    def __call__(self, model: Any) -> T:
        """The fact for a `Model`; not cached for another object with the same fields."""
        numbers = _numbers(model, self.leaves)
        if numbers is None:
            return self.unknown
        structure = getattr(model, "structure", None)
        if structure is None:
            return self.compute(model, *numbers)
        key = model.opt.disableflags, *((x.shape, x.tobytes()) for x in numbers)
        name = f"{self.compute.__module__}.{self.compute.__qualname__}"
        found = structure.facts.get(name)
        if found is None or found[0] != key:
            found = structure.facts[name] = key, self.compute(model, *numbers)
        return found[1]


def fact(*leaves: str, unknown: Any = None) -> Callable[[Callable[..., T]], Fact[T]]:
    """Decorator for `compute(model, *numbers)`; see `Fact`."""
    return lambda compute: Fact(compute, leaves, unknown)


@dataclasses.dataclass(frozen=True)
class Constants:
    """The numbers in some leaves of a model, as a hashable static argument of a jitted function.

    In a function that takes a model as an argument, the leaves are traced and facts that depend on
    them are unknown. If the caller passes `Constants` as a static argument, the function can put
    these leaves back as constants; it is compiled once for each set of numbers.

    Attributes:
      leaves: name, type, shape and bytes of each leaf.
    """

    leaves: tuple[tuple[str, str, tuple[int, ...], bytes], ...] = ()

    @classmethod
    def of(cls, model: Any, names: tuple[str, ...]) -> "Constants":
        """The constants of a model's leaves; empty if one of them is traced."""
        pairs = zip(names, _numbers(model, names) or (), strict=False)
        return cls(tuple((name, x.dtype.str, x.shape, x.tobytes()) for name, x in pairs))

    def put_into(self, model: Any) -> Any:
        """The model with these leaves replaced by the constants."""
        with jax.ensure_compile_time_eval():
            values = {
                name: jnp.asarray(np.frombuffer(data, dtype).reshape(shape))
                for name, dtype, shape, data in self.leaves
            }
        return model.replace(**values)


def _numbers(model: Any, names: tuple[str, ...]) -> list[np.ndarray] | None:
    """The leaves as NumPy arrays, or None if one of them is traced."""
    try:
        return [np.asarray(getattr(model, name)) for name in names]
    except jax.errors.TracerArrayConversionError:
        return None
