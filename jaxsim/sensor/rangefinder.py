"""The range finder: distance along a site's z axis, or through each pixel of a camera."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.collision.rays import RayHit, cast_ray, visible_geoms
from jaxsim.quantities.cameras import pixel_rays
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import CAMERA, Readings

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_Data = mujoco.mjtRayDataField


def rangefinder(r: Readings, g: SensorGroup) -> Float[Array, "n dim"]:
    """Distance (m), -1 if no geom is hit, and the other quantities in the sensors' `data`.

    A camera has one ray through the centre of each pixel, row by row. Geoms of the body that
    carries the sensor and transparent geoms are ignored.
    """
    if g.objtype == CAMERA:
        pos, mat = (x[g.variant] for x in r.frame(CAMERA, np.arange(r.model.ncam)))
        origin, direction = pixel_rays(r.model, g.variant, pos, mat)
        bodies = np.repeat(r.model.cam_bodyid[g.variant], len(origin))
        hit = _hits(r, bodies, origin, direction)
        depth = (origin - pos[None] + hit.distance[:, None] * direction) @ -mat[:, 2]
        image = _data(g, hit, origin, direction, depth).ravel()
        return jnp.broadcast_to(image[None], (len(g), len(image)))
    origin, mat = r.frame(_SITE, g.obj)
    hit = _hits(r, r.model.site_bodyid[g.obj], origin, mat[:, :, 2])
    return _data(g, hit, origin, mat[:, :, 2], hit.distance)


def _data(g: SensorGroup, hit: RayHit, origin, direction, depth) -> Float[Array, "n k"]:
    """What the sensors read of each ray."""
    found = (hit.distance >= 0)[:, None]
    distance = hit.distance[:, None]
    data = {
        _Data.mjRAYDATA_DIST: distance,
        _Data.mjRAYDATA_DIR: jnp.where(found, direction, 0),
        _Data.mjRAYDATA_ORIGIN: origin,
        _Data.mjRAYDATA_POINT: jnp.where(found, origin + distance * direction, 0),
        _Data.mjRAYDATA_NORMAL: hit.normal,
        _Data.mjRAYDATA_DEPTH: jnp.where(found, depth[:, None], -1),
    }
    asked = [value for bit, value in data.items() if g.intprm[0] >> int(bit) & 1]
    return jnp.concatenate(asked, axis=1)


def _hits(r: Readings, bodies: np.ndarray, origin, direction) -> RayHit:
    """The first geom on each ray; ray i ignores the geoms of `bodies[i]`."""
    unique, which = np.unique(bodies, return_inverse=True)
    seen = np.stack([visible_geoms(r.model, bodyexclude=int(body)) for body in unique])
    (geoms,) = seen.any(axis=0).nonzero()
    kin = r.motion.kin

    def cast(origin, direction, seen):
        return cast_ray(r.model, kin.geom_xpos, kin.geom_xmat, origin, direction, geoms, seen)

    return jax.vmap(cast)(origin, direction, jnp.asarray(seen[which][:, geoms]))
