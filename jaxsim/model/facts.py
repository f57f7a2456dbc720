"""Facts: what is known of a model before it moves, computed once and kept with its structure.

A fact follows from the structure, which never changes, and perhaps from the numbers of some leaves.
Those may be replaced, mapped and differentiated, so a fact is looked up by the numbers that the
leaves have at the moment. While one of these leaves is traced, as an argument of a jitted function
is, there are no numbers and the fact is not known; the answer is then the one that is right for all
numbers. So a fact never outlives a change of the model, and no derivative passes it by.
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
    """A function of a model that is computed again only where its answer may be another one.

    Attributes:
      compute: function of a model and of the leaves' numbers as NumPy arrays. Of the model itself
        it reads the structure and `opt.disableflags` only.
      leaves: names of these leaves.
      unknown: the answer where one of them is traced.
    """

    def __init__(self, compute: Callable[..., T], leaves: tuple[str, ...], unknown: Any):
        self.compute, self.leaves, self.unknown = compute, leaves, unknown
        functools.update_wrapper(self, compute)

    def __call__(self, model: Any) -> T:
        """The fact of a `Model`; or of anything with its fields, which is not remembered."""
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
    """Numbers of some leaves of a model, to be part of a program instead of its arguments.

    A program that takes a model as an argument knows no facts that depend on leaves. Whoever calls
    it with numbers can put those leaves back as constants: `Constants` can be hashed, so it says
    which program to compile.

    Attributes:
      leaves: name, type, shape and bytes of each leaf.
    """

    leaves: tuple[tuple[str, str, tuple[int, ...], bytes], ...] = ()

    @classmethod
    def of(cls, model: Any, names: tuple[str, ...]) -> "Constants":
        """These leaves of a model; none of them if one is traced."""
        pairs = zip(names, _numbers(model, names) or (), strict=False)
        return cls(tuple((name, x.dtype.str, x.shape, x.tobytes()) for name, x in pairs))

    def put_into(self, model: Any) -> Any:
        """The model with the constants in place of its leaves."""
        with jax.ensure_compile_time_eval():
            values = {
                name: jnp.asarray(np.frombuffer(data, dtype).reshape(shape))
                for name, dtype, shape, data in self.leaves
            }
        return model.replace(**values)


def _numbers(model: Any, names: tuple[str, ...]) -> list[np.ndarray] | None:
    """These leaves as numbers; None if one of them is traced."""
    try:
        return [np.asarray(getattr(model, name)) for name in names]
    except jax.errors.TracerArrayConversionError:
        return None
