"""Which geoms are known to have the same contact parameters.

Where slots are assigned at run time, the parameters of each would be looked up by traced geom ids
and mixed, environment by environment. In most models a few geoms stand for all: what they share is
looked up and mixed once.

Nothing is lost by it, neither in values nor in derivatives: it is done only where the parameters
are numbers while a program is traced, not arguments that may be mapped or differentiated.
"""

from typing import Any

import numpy as np

from jaxsim.collision.parameters import SURFACE_LEAVES
from jaxsim.model.known import known_leaves

Surfaces = tuple[int, ...]

# The leaves that the parameters of contacts depend on.
SURFACE = (*SURFACE_LEAVES.values(), "geom_margin")


def known_surfaces(model: Any) -> Surfaces | None:
    """For each geom the first with the same contact parameters; None where these are traced.

    Args:
      model: a `Model`, a `mujoco.MjModel`, or anything with their fields. If it says itself what is
        known (`surfaces`), that is it.
    """
    said = getattr(model, "surfaces", None)
    if said is not None:
        return said
    numbers = known_leaves(model, SURFACE)
    if numbers is None:
        return None
    table = np.concatenate([x.reshape(len(x), x[:1].size) for x in numbers], axis=1)
    _, first, kind = np.unique(table, axis=0, return_index=True, return_inverse=True)
    return tuple(first[kind].tolist())
