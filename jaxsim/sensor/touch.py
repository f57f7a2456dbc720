"""The touch sensor: sum of the normal forces of contacts in a site's volume."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather, sum_by, take
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings
from jaxsim.sensor.shapes import ray_hits

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


def touch(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Sum of the normal forces of contacts on a site's body that act through the site (N).

    A contact counts if the ray from its point along the normal force hits the site's volume, as it
    does for a point inside.
    """
    contact, force = r.signals.contact, r.signals.contact_force
    sensor, slot, sign = _pairs(r, g)
    if not len(slot):
        return jnp.zeros((len(g), 1), force.dtype)
    pos, mat = (take(a, sensor) for a in r.frame(_SITE, g.obj))
    size = take(take(r.model.site_size, g.obj), sensor)

    def felt(pos, R, size, point, frame, sign, normal):
        start, direction = R.T @ (point - pos), R.T @ frame[0] * sign
        counts = ray_hits(g.variant, size, start, direction) & (normal > 0) & (sign != 0)
        return jnp.where(counts, normal, 0)

    normal = take(force[:, 0], slot)
    pairs = (pos, mat, size, take(contact.pos, slot), take(contact.frame, slot), sign, normal)
    return sum_by(jax.vmap(felt)(*pairs), sensor, len(g))[:, None]


def _pairs(r: Readings, g: SensorGroup) -> tuple[np.ndarray, np.ndarray, Float[Array, "npair"]]:
    """Pairs of a sensor and a contact slot, and the sign of the normal force on the sensor's body.

    The sign is 1 for the body of geom1, -1 for that of geom2 and 0 for others. If the geoms are
    static, pairs with sign 0 are left out.
    """
    contact = r.signals.contact
    n, m = len(g), len(contact.pos)
    sensor, slot = (a.ravel() for a in np.indices((n, m)))
    body = r.model.site_bodyid[g.obj][sensor]
    body1, body2 = (gather(r.model.geom_bodyid, x)[slot] for x in (contact.geom1, contact.geom2))
    static = isinstance(body1, np.ndarray) and isinstance(body2, np.ndarray)
    where = np.where if static else jnp.where
    sign = where(body2 == body, -1.0, where(body1 == body, 1.0, 0.0))
    if static:
        (keep,) = np.nonzero(sign)
        sensor, slot, sign = sensor[keep], slot[keep], sign[keep]
    return sensor, slot, jnp.asarray(sign, contact.pos.dtype)
