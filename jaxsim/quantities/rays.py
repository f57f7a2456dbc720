"""`ray`: what a ray from a point meets first."""

from collections.abc import Sequence

from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.collision.rays import RayHit, cast_ray, ray_problems, visible_geoms
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.model import Model, ModelError, State
from jaxsim.model.inputs import admit, admit_array


@full_precision
def ray(
    model: Model,
    state: State,
    origin: Float[Array, "3"],
    direction: Float[Array, "3"],
    *,
    geomgroup: Sequence[bool] | None = None,
    flg_static: bool = True,
    bodyexclude: int = -1,
) -> RayHit:
    """Distance to the first geom on a ray, which geom it is and its normal: MuJoCo's `mj_ray`.

    All geoms are tried, the triangles of meshes one by one. For many rays map over `origin` and
    `direction` alone: the poses of the geoms are then computed once. The distance is differentiable
    with respect to the ray, the state and the model; which feature is hit is held fixed.

    Args:
      model: the model.
      state: the state.
      origin: where the ray starts, world coordinates (m).
      direction: where it goes; distances are in units of its length.
      geomgroup: for each of MuJoCo's six groups, whether its geoms are seen; None for all.
      flg_static: whether geoms that are fixed to the world are seen.
      bodyexclude: a body whose geoms are not seen; -1 for none.

    Returns:
      Distance and geom, -1 where nothing is hit, and the unit normal there.

    Raises:
      ModelError: a visible geom is of a type that rays cannot meet.
      TypeError: an argument, or the numbers in an array, are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model, state, _ = admit(model, state)
    origin = admit_array(model, origin, (3,), "origin")
    direction = admit_array(model, direction, (3,), "direction")
    seen = visible_geoms(model, geomgroup, flg_static, bodyexclude)
    for geom in ray_problems(model, seen):
        raise ModelError(f"{model.names.label('geom', geom)}: rays cannot meet geoms of its type")
    kin = kinematics(model, state.qpos, state.mocap_pos, state.mocap_quat)
    return cast_ray(model, kin.geom_xpos, kin.geom_xmat, origin, direction, seen.nonzero()[0])
