"""Which optional forces of a model may be nonzero; compiled programs leave out the others.

This is decided for each row of a leaf. A row may be nonzero if it was so in the loaded model or in
any value that `Model.replace` has put in its place; all rows of a traced leaf may be nonzero. So a
force that was zero at first takes effect when its number is replaced, mapped or differentiated.
"""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

# Leaves of the model, or of its options (`opt.`), and the axes of each.
_AXES = {
    "opt.density": (),
    "opt.viscosity": (),
    "body_gravcomp": ("nbody",),
    "dof_frictionloss": ("nv",),
    "geom_adhesion": ("ngeom",),
    "geom_surfacevel": ("ngeom", "6"),
    "pair_adhesion": ("npair",),
    "tendon_armature": ("ntendon",),
    "tendon_damping": ("ntendon",),
    "tendon_dampingpoly": ("ntendon", "npoly"),
    "tendon_frictionloss": ("ntendon",),
    "actuator_armature": ("nactuator",),
    "actuator_damping": ("nactuator",),
    "actuator_dampingpoly": ("nactuator", "npoly"),
}
OPTIONAL_FORCES = tuple(_AXES)

Presence = tuple[tuple[int, ...], ...]
"""For each leaf in `OPTIONAL_FORCES`, the rows that may be nonzero."""

NOTHING: Presence = ((),) * len(OPTIONAL_FORCES)


def extended(present: Presence, model: Any, updates: dict[str, Any]) -> Presence:
    """The presence after new values have been assigned to some fields of a model.

    Args:
      present: the presence before.
      model: the model before.
      updates: the new values, by field name.
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
    """Rows of a new value that may be nonzero; none if the value is None.

    All rows of a value that is traced, has a batch axis, or is an entry of an `in_axes` tree.
    """
    if value is None:
        return ()
    known = isinstance(value, np.ndarray | jax.Array) and not isinstance(value, jax.core.Tracer)
    if not known or value.ndim != ndim:
        return range(count)
    numbers = np.asarray(value)
    return np.nonzero(numbers.any(axis=tuple(range(1, ndim))) if ndim else [numbers])[0].tolist()
