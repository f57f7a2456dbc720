"""Paths of spatial tendons: the sites and surfaces of their segments.

A segment leads from one site to the next, straight or over one surface. Everything here is static.
"""

import dataclasses

import mujoco
import numpy as np

from jaxsim.model import Model

_JOINT, _PULLEY, _SITE, SPHERE, CYLINDER = (
    int(getattr(mujoco.mjtWrap, f"mjWRAP_{name}"))
    for name in ("JOINT", "PULLEY", "SITE", "SPHERE", "CYLINDER")
)


@dataclasses.dataclass(frozen=True)
class Segments:
    """Segments with the same type of surface, either all with or all without a side site.

    Attributes:
      surface: `mujoco.mjtWrap` of the surface; mjWRAP_SITE for straight segments.
      tendon: (n,) tendon of each segment.
      first: (n,) site where it begins.
      last: (n,) site where it ends.
      geom: (n,) geom of the surface; -1 for straight segments.
      side: (n,) side site; -1 for none.
      pulley: (n,) last pulley before the segment, an index into `wrap_prm`; -1 for none.
    """

    surface: int
    tendon: np.ndarray
    first: np.ndarray
    last: np.ndarray
    geom: np.ndarray
    side: np.ndarray
    pulley: np.ndarray


def spatial_tendons(model: Model) -> np.ndarray:
    """(n,) ids of the spatial tendons."""
    if not model.ntendon:
        return np.zeros(0, int)
    return np.nonzero(model.wrap_type[model.tendon_adr] != _JOINT)[0]


def segments(model: Model) -> tuple[Segments, ...]:
    """The segments of all spatial tendons, grouped by type of surface and use of a side site."""
    rows: dict[tuple[int, bool], list[tuple[int, ...]]] = {}
    for tendon in spatial_tendons(model):
        for surface, row in _along(model, int(tendon)):
            rows.setdefault((surface, row[4] >= 0), []).append(row)
    return tuple(Segments(kind[0], *np.array(rows[kind], int).T) for kind in sorted(rows))


def _along(model: Model, tendon: int):
    """Yield the surface and the other fields of each segment of one tendon."""
    start = int(model.tendon_adr[tendon])
    pulley = first = geom = side = -1
    for i in range(start, start + int(model.tendon_num[tendon])):
        kind, obj = int(model.wrap_type[i]), int(model.wrap_objid[i])
        if kind == _PULLEY:
            pulley, first = i, -1
        elif kind != _SITE:
            geom, side = obj, int(model.wrap_sideid[i])
        else:
            if first >= 0:
                surface = int(model.wrap_type[i - 1]) if geom >= 0 else _SITE
                yield surface, (tendon, first, obj, geom, side, pulley)
            first, geom, side = obj, -1, -1
