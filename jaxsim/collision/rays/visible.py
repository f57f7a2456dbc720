"""Which geoms rays can hit."""

from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np

from jaxsim.collision.rays.primitives import INTERVALS

_Geom = mujoco.mjtGeom
_KNOWN = (int(_Geom.mjGEOM_PLANE), int(_Geom.mjGEOM_HFIELD), int(_Geom.mjGEOM_MESH), *INTERVALS)


def opaque_geoms(mj: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) whether each geom, or else its material, has a nonzero alpha."""
    own, looks = mj.geom_rgba[:, 3], np.append(mj.mat_rgba[:, 3], 0)
    return np.where(mj.geom_matid < 0, own, looks[mj.geom_matid]) != 0


def visible_geoms(
    model: Any,
    geomgroup: Sequence[bool] | None = None,
    flg_static: bool = True,
    bodyexclude: int = -1,
) -> np.ndarray:
    """(ngeom,) whether a ray can hit each geom, by `mj_ray`'s rules; not if it is transparent."""
    body = model.geom_bodyid
    seen = model.geom_opaque & (body != bodyexclude)
    if not flg_static:
        seen = seen & (model.body_weldid[body] != 0)
    if geomgroup is not None:
        groups = np.asarray(geomgroup, bool)
        seen = seen & groups[np.clip(model.geom_group, 0, len(groups) - 1)]
    return seen


def ray_problems(model: Any, seen: np.ndarray) -> Iterator[int]:
    """Visible geoms of a type that rays do not support."""
    yield from np.flatnonzero(seen & ~np.isin(model.geom_type, _KNOWN)).tolist()
