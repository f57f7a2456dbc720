"""A scene to draw from a `Model`, which has kept the shapes but not the looks of its source."""

import mujoco
import numpy as np

from jaxsim.joints import JOINTS
from jaxsim.model import Model

_GEOM = mujoco.mjtGeom
_DRAWN = {
    int(g)
    for g in (
        _GEOM.mjGEOM_PLANE,
        _GEOM.mjGEOM_SPHERE,
        _GEOM.mjGEOM_CAPSULE,
        _GEOM.mjGEOM_ELLIPSOID,
        _GEOM.mjGEOM_CYLINDER,
        _GEOM.mjGEOM_BOX,
    )
}
_STILL, _MOVING = (0.7, 0.75, 0.8, 1), (0.85, 0.5, 0.25, 1)


def scene(model: Model) -> mujoco.MjModel:
    """A model for drawing: the same bodies, joints and primitive geoms, colours of our own.

    Its `qpos` is the model's, so that poses can be copied; its dynamics mean nothing.

    Args:
      model: the model; meshes, height fields and tendons are not drawn.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.worldbody.add_light(pos=[0, -3, 6], dir=[0, 0.45, -0.9])
    _add_sky_and_tiles(spec)
    bodies = [spec.worldbody]
    for body in range(1, model.nbody):
        bodies.append(_add_body(model, bodies[model.body_parentid[body]], body))
    for geom in np.flatnonzero([t in _DRAWN for t in model.geom_type]):
        _add_geom(model, bodies[model.geom_bodyid[geom]], int(geom))
    return spec.compile()


def _add_body(model: Model, parent, body: int):
    added = parent.add_body(
        pos=np.asarray(model.body_pos[body], float),
        quat=np.asarray(model.body_quat[body], float),
        mocap=bool(model.body_mocapid[body] >= 0),
        mass=1.0,
        inertia=[1.0, 1.0, 1.0],
        explicitinertial=True,
    )
    for joint in np.flatnonzero(model.jnt_bodyid == body):
        kind = int(model.jnt_type[joint])
        added.add_joint(
            type=mujoco.mjtJoint(kind),
            pos=np.asarray(model.jnt_pos[joint], float),
            axis=np.asarray(model.jnt_axis[joint], float),
            ref=float(model.qpos0[model.jnt_qposadr[joint]]) if JOINTS[kind].nq == 1 else 0.0,
        )
    return added


def _add_geom(model: Model, body, geom: int) -> None:
    body.add_geom(
        type=mujoco.mjtGeom(int(model.geom_type[geom])),
        size=np.asarray(model.geom_size[geom], float),
        pos=np.asarray(model.geom_pos[geom], float),
        quat=np.asarray(model.geom_quat[geom], float),
        rgba=_STILL if model.body_weldid[model.geom_bodyid[geom]] == 0 else _MOVING,
        material="tiles" if model.geom_type[geom] == _GEOM.mjGEOM_PLANE else "",
        contype=0,
        conaffinity=0,
    )


def _add_sky_and_tiles(spec: mujoco.MjSpec) -> None:
    """Something to see motion against."""
    sky = {
        "builtin": mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        "rgb1": [0.8, 0.88, 1],
        "rgb2": [1, 1, 1],
    }
    spec.add_texture(type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384, **sky)
    tiles = {"builtin": mujoco.mjtBuiltin.mjBUILTIN_CHECKER, "rgb1": [0.9] * 3, "rgb2": [0.75] * 3}
    spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, width=128, height=128, **tiles
    )
    material = spec.add_material(name="tiles", texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
