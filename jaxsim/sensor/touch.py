"""The touch sensor: sum of the normal forces of contacts in a site's volume."""

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings
from jaxsim.sensor.shapes import ray_hits
from jaxsim.sensor.touch_pairs import touch_pairs

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


def touch(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Sum of the normal forces of contacts on a site's body that act through the site (N).

    A contact counts if the ray from its point along the normal force hits the site's volume, as it
    does for a point inside.
    """
    contact, force = r.signals.contact, r.signals.contact_force
    sensor, slot, sign = touch_pairs(r, g, _signs)
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


def _signs(xp, body, body1, body2):
    """Signs of the normal force on a sensor's body: 1 for that of geom1, -1 for that of geom2."""
    return xp.where(body2 == body, -1.0, xp.where(body1 == body, 1.0, 0.0))
