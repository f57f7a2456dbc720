"""`geom_distance`: distance and nearest points of two geoms."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.collision.distance import distance_problems, geom_distances
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.model import Model, ModelError, State
from jaxsim.model.inputs import admit


class GeomDistance(NamedTuple):
    """Distance and nearest points of two geoms.

    Attributes:
      distance: signed distance, negative for overlap, at most `distmax` (m).
      fromto: nearest points of the first and of the second (m); zeros if `distmax` is reached.
    """

    distance: Float[Array, ""]
    fromto: Float[Array, "2 3"]


@full_precision
def geom_distance(
    model: Model, state: State, geom1: int | str, geom2: int | str, distmax: float = 1e10
) -> GeomDistance:
    """Signed distance and nearest points of two geoms, as MuJoCo's `mj_geomDistance`.

    Meshes are replaced by their convex hulls. The result is differentiable with respect to the
    state and the model, with the nearest features held fixed.

    Args:
      model: the model.
      state: the state.
      geom1: first geom, by number or by name.
      geom2: second geom, by number or by name.
      distmax: largest distance; larger ones are clipped (m).

    Raises:
      ModelError: distances between these types are not supported, or a mesh that cannot collide has
        no hull.
      IndexError: there is no geom with this number.
      KeyError: there is no geom with this name.
      TypeError: an argument is of the wrong class, or its numbers are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, state, _ = admit(model, state)
    pair = np.array([[_number(model, geom1), _number(model, geom2)]])
    for geom in distance_problems(model, pair):
        raise ModelError(
            f"{model.names.label('geom', geom)}: no distance can be measured; height fields and "
            "signed distance functions have none, and meshes that cannot collide have no hull, let "
            "them collide with something"
        )
    kin = kinematics(model, state.qpos, state.mocap_pos, state.mocap_quat)
    limit = jnp.full(1, distmax, kin.geom_xpos.dtype)
    dist, segment = geom_distances(model, kin.geom_xpos, kin.geom_xmat, pair, limit)
    return GeomDistance(dist[0], segment[0].reshape(2, 3))


def _number(model: Model, geom: int | str) -> int:
    if isinstance(geom, str):
        return model.names.id("geom", geom)
    if not 0 <= geom < model.ngeom:
        raise IndexError(f"the model has {model.ngeom} geoms, got number {geom}")
    return int(geom)
