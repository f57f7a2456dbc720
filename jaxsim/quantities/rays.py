"""`ray`: the first geom on a ray."""

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
    """Distance, geom and normal at the first intersection of a ray, as MuJoCo's `mj_ray`.

    All geoms are tested, and all triangles of meshes. For many rays, use `vmap` over `origin` and
    `direction` only: the poses of the geoms are then computed once. The distance is differentiable
    with respect to the ray, the state and the model, with the hit feature held fixed.

    Args:
      model: the model.
      state: the state.
      origin: start of the ray, world coordinates (m).
      direction: direction of the ray; the distance is in units of its length.
      geomgroup: for each of MuJoCo's six groups, whether rays hit its geoms; None for all.
      flg_static: whether rays hit geoms that are fixed to the world.
      bodyexclude: body whose geoms are ignored; -1 for none.

    Returns:
      Distance and geom, both -1 if nothing is hit, and the unit normal there.

    Raises:
      ModelError: rays do not support the type of a visible geom.
      TypeError: an argument is of the wrong class, or its numbers are of the wrong type.
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
