"""The range finder: distance along a site's z axis to the first geom."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.collision.rays import RayHit, cast_ray, visible_geoms
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_Data = mujoco.mjtRayDataField


def rangefinder(r: Readings, g: SensorGroup) -> Float[Array, "n dim"]:
    """Distance (m), -1 if no geom is hit, and the other quantities in the sensors' `data`.

    Geoms of the site's own body and transparent geoms are ignored.
    """
    origin, mat = r.frame(_SITE, g.obj)
    direction = mat[:, :, 2]
    hit = _hits(r, r.model.site_bodyid[g.obj], origin, direction)
    found = (hit.distance >= 0)[:, None]
    distance = hit.distance[:, None]
    data = {
        _Data.mjRAYDATA_DIST: distance,
        _Data.mjRAYDATA_DIR: jnp.where(found, direction, 0),
        _Data.mjRAYDATA_ORIGIN: origin,
        _Data.mjRAYDATA_POINT: jnp.where(found, origin + distance * direction, 0),
        _Data.mjRAYDATA_NORMAL: hit.normal,
        _Data.mjRAYDATA_DEPTH: distance,
    }
    asked = [value for bit, value in data.items() if g.intprm[0] >> int(bit) & 1]
    return jnp.concatenate(asked, axis=1)


def _hits(r: Readings, bodies: np.ndarray, origin, direction) -> RayHit:
    """The first geom on each ray; ray i ignores the geoms of `bodies[i]`."""
    seen = np.stack([visible_geoms(r.model, bodyexclude=int(body)) for body in bodies])
    (geoms,) = seen.any(axis=0).nonzero()
    kin = r.motion.kin

    def cast(origin, direction, seen):
        return cast_ray(r.model, kin.geom_xpos, kin.geom_xmat, origin, direction, geoms, seen)

    return jax.vmap(cast)(origin, direction, jnp.asarray(seen[:, geoms]))
