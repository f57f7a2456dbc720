"""The bodies of a model without its joints: a `mujoco.MjModel` in which they move freely.

Bodies keep their ids, so that tables of one model are those of the other. Everything else that acts
between bodies, joints, equalities, actuators and tendons, belongs to the model itself.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from jaxsim.collision import find_candidates
from jaxsim.model import ModelError

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
_GEOM = (
    "type contype conaffinity condim priority solmix solref solimp size friction margin gap pos "
    "quat"
).split()
_PAIR = "solref solreffriction solimp margin gap friction".split()


def free_bodies(mj: mujoco.MjModel) -> mujoco.MjModel:
    """The model with a free joint for each moving body and without other joints.

    Geoms touch as they do in `mj`: pairs that it filters out, of a body and its parent for
    instance, are excluded.

    Raises:
      ModelError: a body has no mass of its own, or hangs on a mocap body; or a geom is a height
        field.
    """
    spec = _spec(mj)
    for one, two in _more_pairs(_compiled(spec, mj), mj):
        spec.add_exclude(bodyname1=_name(one), bodyname2=_name(two))
    return _compiled(spec, mj)


def _spec(mj: mujoco.MjModel) -> mujoco.MjSpec:
    spec, data = mujoco.MjSpec(), mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    for mesh in range(mj.nmesh):
        spec.add_mesh(name=_name(mesh), uservert=_vertices(mj, mesh), userface=_faces(mj, mesh))
    for body in range(1, mj.nbody):
        _add_body(spec, mj, data, body)
    for geom in range(mj.ngeom):
        _add_geom(spec, mj, geom)
    for i in range(mj.npair):
        numbers = {name: getattr(mj, f"pair_{name}")[i].tolist() for name in _PAIR}
        numbers["condim"] = int(mj.pair_dim[i])
        names = _name(mj.pair_geom1[i]), _name(mj.pair_geom2[i])
        spec.add_pair(geomname1=names[0], geomname2=names[1], **numbers)
    return spec


def _add_body(spec: mujoco.MjSpec, mj: mujoco.MjModel, data: mujoco.MjData, body: int) -> None:
    """A body at its place in the reference configuration."""
    made = spec.worldbody.add_body(
        name=_name(body), pos=data.xpos[body], quat=data.xquat[body], gravcomp=0.0
    )
    if mj.body_weldid[body] == 0:
        _check_static(mj, body)
        made.mocap = bool(mj.body_mocapid[body] >= 0)
        return
    if mj.body_mass[body] <= 0 or mj.body_inertia[body].min() <= 0:
        raise ModelError(
            f"body {_label(mj, body)} moves and has no inertia of its own, so it cannot be a free "
            "body; move what it carries to its parent, or give it a mass"
        )
    made.explicitinertial = True
    made.mass, made.ipos, made.iquat = mj.body_mass[body], mj.body_ipos[body], mj.body_iquat[body]
    made.inertia = mj.body_inertia[body]
    made.add_freejoint()


def _check_static(mj: mujoco.MjModel, body: int) -> None:
    root = mj.body_rootid[body]
    if root != body and mj.body_mocapid[root] >= 0:
        raise ModelError(
            f"body {_label(mj, body)} hangs on a mocap body, which maximal coordinates do not "
            "carry over; make it a mocap body itself"
        )


def _add_geom(spec: mujoco.MjSpec, mj: mujoco.MjModel, geom: int) -> None:
    if mj.geom_type[geom] == _HFIELD:
        raise ModelError(
            f"geom {geom} is a height field, which maximal coordinates do not carry over"
        )
    body = spec.worldbody if not mj.geom_bodyid[geom] else spec.body(_name(mj.geom_bodyid[geom]))
    numbers = {name: getattr(mj, f"geom_{name}")[geom].tolist() for name in _GEOM}
    if mj.geom_type[geom] == _MESH:
        numbers["meshname"] = _name(mj.geom_dataid[geom])
        del numbers["size"]
    body.add_geom(name=_name(geom), mass=0.0, rgba=mj.geom_rgba[geom], **numbers)


def _compiled(spec: mujoco.MjSpec, mj: mujoco.MjModel) -> mujoco.MjModel:
    """The compiled spec with the options of `mj`."""
    found = spec.compile()
    for name in dir(mj.opt):
        if not name.startswith("_"):
            value = getattr(mj.opt, name)
            if isinstance(value, np.ndarray):
                getattr(found.opt, name)[:] = value
            else:
                setattr(found.opt, name, value)
    return found


def _more_pairs(free: mujoco.MjModel, mj: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    """Pairs of bodies whose geoms may touch in `free` only."""
    kept = _pairs(mj)
    more = {(int(mj.geom_bodyid[a]), int(mj.geom_bodyid[b])) for a, b in _pairs(free) - kept}
    yield from sorted({(min(pair), max(pair)) for pair in more})


def _pairs(mj: mujoco.MjModel) -> set[tuple[int, int]]:
    """Geoms that may touch without an explicit pair."""
    return {
        (min(a, b), max(a, b))
        for group in find_candidates(mj).groups
        for a, b, pair in zip(
            group.geom1.tolist(), group.geom2.tolist(), group.pair.tolist(), strict=True
        )
        if pair < 0
    }


def _vertices(mj: mujoco.MjModel, mesh: int) -> np.ndarray:
    first = mj.mesh_vertadr[mesh]
    return mj.mesh_vert[first : first + mj.mesh_vertnum[mesh]].ravel()


def _faces(mj: mujoco.MjModel, mesh: int) -> np.ndarray:
    first = mj.mesh_faceadr[mesh]
    return mj.mesh_face[first : first + mj.mesh_facenum[mesh]].ravel()


def _name(i) -> str:
    return f"{int(i)}"


def _label(mj: mujoco.MjModel, body: int) -> str:
    return repr(mj.body(body).name or body)
