"""Cables: bodies with MuJoCo's plugin `mujoco.elasticity.cable`.

Bodies of one instance follow each other in a chain. Each but the first resists the rotation of its
joint, as an elastic rod does.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from jaxsim.io.plugins import number, plugins
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

NAME = "mujoco.elasticity.cable"
_ROUND = int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
_BALL, _FREE = int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_FREE)


def cable_leaf(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """The model's leaf `body_cable`: (nbody, 3) stiffness of each body's joint (N m / rad).

    It is `(G J, E I_y, E I_z) / L` with the plugin's `twist` G and `bend` E (Pa), the cross-section
    of the body's first geom, and the distance L from the body before (m). Zero elsewhere.
    """
    stiffness, cables = np.zeros((mj.nbody, 3)), list(_cables(mj))
    if not cables:
        return {"body_cable": stiffness}
    data = mujoco.MjData(mj)
    data.qpos[:] = mj.qpos0
    mujoco.mj_kinematics(mj, data)
    for bodies, given in cables:
        twist, bend = number(given["twist"]), number(given["bend"])
        for body in bodies[1:]:
            length = np.linalg.norm(data.xpos[body] - data.xpos[body - 1])
            moments = _moments(mj, body) * np.array([twist, bend, bend])
            stiffness[body] = moments / length if moments.any() else 0
    return {"body_cable": stiffness}


def cable_tables(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields of the model's structure that describe cables.

    Returns:
      `cable_body` (n,): bodies that resist their joint's rotation, in the axes of the body before.
      `cable_qposadr` (n,): where their quaternions are in `qpos`. `cable_curvature` (n, 3): the
      rotation vectors at rest. `cable_reacts` (n,): whether the body before feels the reaction;
      MuJoCo skips bodies without stiffness of their own.
    """
    body, place, rest, reacts = [], [], [], []
    for bodies, given in _cables(mj):
        stiff = [_stiff(mj, b, given) for b in bodies]
        for k, b in enumerate(bodies[1:], 1):
            adr, curvature = _quaternion(mj, b), np.zeros(3)
            if given["flat"] != "true":
                mujoco.mju_subQuat(curvature, mj.body_quat[b], mj.qpos0[adr : adr + 4])
            if stiff[k]:
                body.append(b)
                place.append(adr)
                rest.append(curvature)
                reacts.append(stiff[k - 1])
    return {
        "cable_body": np.array(body, int),
        "cable_qposadr": np.array(place, int),
        "cable_curvature": np.array(rest).reshape(-1, 3),
        "cable_reacts": np.array(reacts, bool),
    }


def unsupported_bodies(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Bodies with other plugins, and cables that MuJoCo's plugin does not define."""
    instances = plugins(mj)
    for body in map(int, np.flatnonzero(mj.body_plugin >= 0)):
        given = instances[mj.body_plugin[body]]
        who, before = label("body", body), mj.body_plugin[body - 1] == mj.body_plugin[body]
        if given.name != NAME:
            yield ModelProblem(who, f"the only plugin of bodies that is supported is {NAME!r}")
        elif before and mj.body_parentid[body] != body - 1:
            yield ModelProblem(who, "its cable must be a chain: give each branch its own instance")
        elif before and _stiff(mj, body, given.attributes) and _quaternion(mj, body) < 0:
            yield ModelProblem(who, "a body of a cable needs a ball joint, as its last joint")
        elif before and not np.abs(mj.body_pos[body]).any():
            yield ModelProblem(who, "a body of a cable must be away from the one before")


def _cables(mj: mujoco.MjModel) -> Iterator[tuple[np.ndarray, dict[str, str]]]:
    """The bodies of each cable, and the attributes of its plugin."""
    for instance, plugin in enumerate(plugins(mj)):
        bodies = np.flatnonzero(mj.body_plugin == instance)
        if plugin.name == NAME and len(bodies):
            yield bodies, plugin.attributes


def _stiff(mj: mujoco.MjModel, body: int, given: dict[str, str]) -> bool:
    twist, bend = number(given["twist"]), number(given["bend"])
    return bool((_moments(mj, body) * np.array([twist, bend, bend])).any())


def _quaternion(mj: mujoco.MjModel, body: int) -> int:
    """Where the quaternion of a body's last joint is in `qpos`; -1 if it has none."""
    last = mj.body_jntadr[body] + mj.body_jntnum[body] - 1
    if not mj.body_jntnum[body] or mj.jnt_type[last] not in (_BALL, _FREE):
        return -1
    return int(mj.jnt_qposadr[last]) + (3 if mj.jnt_type[last] == _FREE else 0)


def _moments(mj: mujoco.MjModel, body: int) -> np.ndarray:
    """Torsion constant and second moments of area about y and z of the first geom (m^4).

    Of a rectangle, the torsion constant is Roark's approximation.
    """
    geom = mj.body_geomadr[body]
    if geom >= 0 and mj.geom_type[geom] in _ROUND:
        return np.pi * mj.geom_size[geom, 0] ** 4 * np.array([1 / 2, 1 / 4, 1 / 4])
    if geom >= 0 and mj.geom_type[geom] == _BOX:
        y, z = mj.geom_size[geom, 1:]
        long, short = max(y, z), min(y, z)
        ratio = short / long
        twist = long * short**3 * (16 / 3 - 3.36 * ratio * (1 - ratio**4 / 12))
        return np.array([twist, 4 / 3 * z**3 * y, 4 / 3 * y**3 * z])
    return np.zeros(3)
