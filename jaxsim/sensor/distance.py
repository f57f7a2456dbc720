"""Sensors of distances between geoms, or between all geoms of two bodies."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.collision.distance import geom_distances, measured_pairs
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings


def geomdist(r: Readings, g: SensorGroup) -> Float[Array, "n 1"]:
    """Signed distance, clipped to the cutoff (m)."""
    return _nearest(r, g)[0][:, None]


def geomnormal(r: Readings, g: SensorGroup) -> Float[Array, "n 3"]:
    """Direction between the nearest points, from first to second; zero beyond the cutoff."""
    segment = _nearest(r, g)[1]
    return jax.vmap(lambda v: v / norm_and_divisor(v)[1])(segment[:, 3:] - segment[:, :3])


def geomfromto(r: Readings, g: SensorGroup) -> Float[Array, "n 6"]:
    """Nearest points of the first and of the second; zero beyond the cutoff (m)."""
    return _nearest(r, g)[1]


def _nearest(r: Readings, g: SensorGroup) -> tuple[Float[Array, "n"], Float[Array, "n 6"]]:
    """Distance and nearest points of the closest pair of geoms of each sensor."""
    model, kin = r.model, r.motion.kin
    parts = [measured_pairs(model, int(s)) for s in g.sensors]
    owner = np.repeat(np.arange(len(g)), [len(part) for part in parts])
    cutoff = take(model.sensor_cutoff, g.sensors)
    dist, segment = geom_distances(
        model, kin.geom_xpos, kin.geom_xmat, np.concatenate(parts), take(cutoff, owner)
    )
    if len(owner) == len(g) and (np.diff(owner) == 1).all():
        return dist, segment
    starts = np.searchsorted(owner, np.arange(len(g) + 1))
    rows = []
    for i, (start, stop) in enumerate(zip(starts, starts[1:], strict=False)):
        if start == stop:
            rows.append((cutoff[i], jnp.zeros_like(segment[0])))
            continue
        nearest = start + jnp.argmin(dist[start:stop])
        rows.append((dist[nearest], segment[nearest]))
    return tuple(jnp.stack(x) for x in zip(*rows, strict=True))  # type: ignore[return-value]
