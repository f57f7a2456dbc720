"""Pairs of a sensor of touch and a contact on its body."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings

Signs = Callable[[Any, np.ndarray, Any, Any], Any]
"""From NumPy or JAX, bodies of sites, and bodies of geom1 and geom2 of contacts to signs."""


def touch_pairs(
    r: Readings, g: SensorGroup, signs: Signs
) -> tuple[np.ndarray, np.ndarray, Float[Array, "npair"]]:
    """Sensors of sites, contact slots, and what turns a contact's force into the sensor's.

    The sign is 0 for contacts of other bodies. If the geoms are static, such pairs are left out.
    """
    contact, model = r.signals.contact, r.model
    sensor, slot = (a.ravel() for a in np.indices((len(g), len(contact.pos))))
    body = model.site_bodyid[g.obj][sensor]
    body1, body2 = (gather(model.geom_bodyid, x)[slot] for x in (contact.geom1, contact.geom2))
    static = isinstance(body1, np.ndarray) and isinstance(body2, np.ndarray)
    sign = signs(np if static else jnp, body, body1, body2)
    if static:
        (keep,) = np.nonzero(sign)
        sensor, slot, sign = sensor[keep], slot[keep], sign[keep]
    return sensor, slot, jnp.asarray(sign, contact.pos.dtype)
