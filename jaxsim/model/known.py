"""What is known of a model while a program is traced."""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np


def known_leaves(model: Any, names: Iterable[str]) -> list[np.ndarray] | None:
    """These leaves as numbers; None if one of them is traced.

    Args:
      model: a `Model`, a `mujoco.MjModel`, or anything with their fields.
      names: the leaves.
    """
    try:
        return [np.asarray(getattr(model, name)) for name in names]
    except jax.errors.TracerArrayConversionError:
        return None
