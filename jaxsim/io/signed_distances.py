"""Geoms whose shapes are given by signed distance functions of the user."""

import copy
from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.collision.sdf import SignedDistance
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

Functions = Mapping[str, Callable[..., Any] | tuple[Callable[..., Any], Any]]
"""By name of a geom: a function of a point, or a function of a point and parameters, and these."""

_SDF = int(mujoco.mjtGeom.mjGEOM_SDF)
_UNBOUNDED = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)
# The function is tried on a grid of this many points along the edges of the geom's box.
_TRIED = 9


def with_functions(mj: mujoco.MjModel, functions: Functions) -> mujoco.MjModel:
    """A copy of the compiled model in which these geoms are of type SDF.

    Their sizes are the half-lengths of boxes around the geoms that stand in for them.

    Raises:
      ValueError: there is no such geom, or it is unbounded.
    """
    mj = copy.copy(mj)
    for name in functions:
        geom = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_GEOM, name)
        if geom < 0:
            raise ValueError(f"sdf: there is no geom {name!r}")
        if mj.geom_type[geom] in _UNBOUNDED:
            raise ValueError(
                f"sdf: geom {name!r} must have a box around it; give it type box, ellipsoid, mesh "
                "or another one that contains the shape"
            )
        mj.geom_type[geom] = _SDF
        mj.geom_plugin[geom] = -1  # the function has the place of an engine plugin
        mj.geom_size[geom] = np.abs(mj.geom_aabb[geom, :3]) + mj.geom_aabb[geom, 3:]
    return mj


def without_functions(
    mj: mujoco.MjModel, pairs: np.ndarray, functions: Functions, label: Label
) -> Iterator[ModelProblem]:
    """Geoms of type sdf that may collide, but have no function.

    Args:
      mj: a model made by `with_functions`.
      pairs: candidate pairs as `candidate_pairs` returns them.
      functions: by the name of a geom.
      label: from (kind, id) to the name of an element in messages.
    """
    for geom in np.unique(pairs[:, :2]):
        name = mujoco.mj_id2name(mj, mujoco.mjtObj.mjOBJ_GEOM, geom)
        if mj.geom_type[geom] == _SDF and name not in functions:
            yield ModelProblem(
                label("geom", int(geom)),
                "type 'sdf' collides only by a function of yours; give it a name and load with "
                'sdf={"name": function}, or set its type to mesh, or contype and conaffinity to 0',
            )


def signed_distances(mj: mujoco.MjModel, functions: Functions) -> dict[str, SignedDistance]:
    """The functions, with their parameters as arrays.

    Args:
      mj: a model made by `with_functions`.
      functions: by the name of a geom.

    Raises:
      TypeError: what should be a function is none.
      ValueError: a function does not return a finite number, or reaches beyond the geom's box.
    """
    made = {}
    for name, given in functions.items():
        function, parameters = given if isinstance(given, tuple) else (given, None)
        if not callable(function):
            raise TypeError(f"sdf: geom {name!r} needs a function, got {type(function).__name__}")
        parameters = jax.tree.map(lambda x: jnp.asarray(x, float), parameters)
        made[name] = SignedDistance(parameters, cast(Callable[..., Any], function))
        geom = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_GEOM, name)
        _check(name, made[name], mj.geom_size[geom])
    return made


def _check(name: str, made: SignedDistance, half: np.ndarray) -> None:
    """Try the function on the faces of the geom's box."""
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, _TRIED)] * 3), axis=-1).reshape(-1, 3)
    points = jnp.asarray(grid[np.abs(grid).max(axis=1) == 1] * half, float)
    rest = () if made.parameters is None else (made.parameters,)
    shape = jax.eval_shape(made.function, points[0], *rest)
    if jax.tree.structure(shape) != jax.tree.structure(0) or shape.shape != ():
        raise ValueError(f"sdf: the function of geom {name!r} must return one number")
    values = np.asarray(jax.vmap(lambda x: made.function(x, *rest))(points))
    if not np.isfinite(values).all():
        raise ValueError(f"sdf: the function of geom {name!r} is not finite around its box")
    if values.min() < -1e-3 * half.min():
        raise ValueError(
            f"sdf: the shape of geom {name!r} reaches beyond the box around the geom; make the "
            "geom larger, it has to contain the shape"
        )
