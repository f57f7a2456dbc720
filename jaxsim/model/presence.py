"""Which forces a model has: programs leave out what is zero.

A leaf counts as zero row by row. What it is when the model is built, and all that `Model.replace`
puts in its place later, decides; a traced leaf may be anything. So a force that was zero at first
takes effect when its number is replaced, mapped or differentiated.
"""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

# Leaves of the model and, after a dot, of its options; their axes by the sizes of a model.
_AXES = {
    "opt.density": (),
    "opt.viscosity": (),
    "body_gravcomp": ("nbody",),
    "dof_frictionloss": ("nv",),
    "tendon_damping": ("ntendon",),
    "tendon_dampingpoly": ("ntendon", "npoly"),
    "tendon_frictionloss": ("ntendon",),
    "actuator_damping": ("nu",),
    "actuator_dampingpoly": ("nu", "npoly"),
}
OPTIONAL_FORCES = tuple(_AXES)

Presence = tuple[tuple[int, ...], ...]
"""For each of `OPTIONAL_FORCES` the rows that may be other than zero."""

NOTHING: Presence = ((),) * len(OPTIONAL_FORCES)


def extended(present: Presence, model: Any, updates: dict[str, Any]) -> Presence:
    """The presence after some fields of a model have got other values.

    Args:
      present: the presence before.
      model: the model before.
      updates: new values by the names of fields.
    """
    rows = []
    for (name, axes), before in zip(_AXES.items(), present, strict=True):
        field, _, option = name.partition(".")
        value = updates.get(field)
        value = getattr(value, option) if option and value is not None else value
        count = getattr(model, axes[0]) if axes else 1
        rows.append(tuple(sorted({*before, *_nonzero_rows(value, count, len(axes))})))
    return tuple(rows)


def _nonzero_rows(value: Any, count: int, ndim: int) -> Iterable[int]:
    """Rows of a new value that may be other than zero; none if there is no new value.

    All of a traced leaf, of a leaf with a batch axis, and of one that is an axis for `jax.vmap`.
    """
    if value is None:
        return ()
    known = isinstance(value, np.ndarray | jax.Array) and not isinstance(value, jax.core.Tracer)
    if not known or value.ndim != ndim:
        return range(count)
    numbers = np.asarray(value)
    return np.nonzero(numbers.any(axis=tuple(range(1, ndim))) if ndim else [numbers])[0].tolist()
