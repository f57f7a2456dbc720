"""The touch grid, MuJoCo's plugin `mujoco.sensor.touch_grid`: an image of contact forces.

The site looks along its negative z axis. A contact at the point p in the site's frame is seen at

    azimuth = atan2(p_x, -p_z),    elevation = atan2(p_y, sqrt(p_x^2 + p_z^2))

and its force is added to the pixel whose edges enclose these angles. The edges are `a e(t)`, where
t is evenly spaced from -1 to 1, a is the field of view, and `e(t) = gamma t^5 + (1 - gamma) t`
makes the pixels in the middle smaller.
"""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.indexing import gather, sum_by, take
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings
from jaxsim.sensor.touch_pairs import touch_pairs

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
# Channels are force and torque along the axes of the site in this order.
_CHANNELS = np.array([2, 0, 1, 5, 3, 4])


def touch_grid(r: Readings, g: SensorGroup) -> Float[Array, "n dim"]:
    """Channels of an image, each row by row from the lowest elevation (N, N m).

    Contacts count on all bodies that are welded to that of the site. As in MuJoCo, the force is
    that on the site's body if its id is the larger one, otherwise its reaction.
    """
    grid = r.model.sensor_grid[g.sensors[0]]
    channels, columns, rows = grid[:3].astype(int)
    azimuths, elevations = _edges(columns, *grid[[3, 5]]), _edges(rows, *grid[[4, 5]])
    sensor, slot, sign = touch_pairs(r, g, functools.partial(_signs, r.model.body_weldid))
    contact = r.signals.contact
    if not len(slot):
        return jnp.zeros((len(g), channels * rows * columns), contact.pos.dtype)
    pos, mat = (take(a, sensor) for a in r.frame(_SITE, g.obj))

    def seen(pos, R, point, frame, wrench):
        x, y, z = R.T @ (point - pos)
        column = _within(azimuths, jnp.arctan2(x, -z))
        row = _within(elevations, jnp.arctan2(y, jnp.sqrt(x**2 + z**2)))
        turned = (wrench.reshape(2, 3) @ frame @ R).ravel()[_CHANNELS[:channels]]
        pixel = row[None, :, None] & column[None, None, :]
        return jnp.where(pixel, turned[:, None, None], 0)

    wrench = sign[:, None] * take(r.signals.contact_force, slot)
    pairs = pos, mat, take(contact.pos, slot), take(contact.frame, slot), wrench
    return sum_by(jax.vmap(seen)(*pairs), sensor, len(g)).reshape(len(g), -1)


def _edges(n: int, angle: float, gamma: float) -> np.ndarray:
    """(n + 1,) edges of pixels (rad)."""
    t = np.add.accumulate([-1.0, *[2 / n] * n])
    return angle * (gamma * t**5 + (1 - gamma) * t)


def _within(edges: np.ndarray, angle: Float[Array, ""]) -> Bool[Array, "n"]:
    """Between which two edges an angle is; it may be equal to the upper one."""
    at = jnp.asarray(edges, angle.dtype)
    return (at[:-1] < angle) & (angle <= at[1:])


def _signs(weld: np.ndarray, xp, body, body1, body2):
    own = weld[body]
    touched = (gather(weld, body1) == own) | (gather(weld, body2) == own)
    return xp.where(touched, xp.where(own < xp.maximum(body1, body2), -1.0, 1.0), 0.0)
