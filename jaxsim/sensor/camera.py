"""The camera projection: pixel coordinates of a site."""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.quantities.cameras import focal_lengths, image_size
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import CAMERA, Readings, into_frame

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


def camprojection(r: Readings, g: SensorGroup) -> Float[Array, "n 2"]:
    """Pixel coordinates of a site in a camera's image, from its upper left corner.

    As in MuJoCo, the image's middle is the principal point, and the projection is perspective.
    """
    pos, _ = r.frame(_SITE, g.obj)
    origin, mat = r.frame(CAMERA, g.ref)
    seen = into_frame(mat, pos - origin)
    behind = jnp.where(seen[:, 2:] < 0, -MINVAL, MINVAL)
    depth = jnp.where(jnp.abs(seen[:, 2:]) < MINVAL, behind, seen[:, 2:])
    focal, middle = focal_lengths(r.model, g.ref), image_size(r.model, g.ref) / 2
    return middle + focal * jnp.asarray([[-1.0, 1.0]], pos.dtype) * seen[:, :2] / depth
