"""MuJoCo's scene of one environment, or of several side by side."""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from jaxsim.viz.batch import places
from jaxsim.viz.cameras import Camera, camera_of, reach_of
from jaxsim.viz.drawing import bounds, moving_bodies
from jaxsim.viz.marks import add_center_of_mass, add_contacts
from jaxsim.viz.stage import STAGE_GEOMS, stage

_PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
_HIDDEN = 5  # a group of geoms that is not drawn
_ROOM = 1000  # for marks, and for what MuJoCo adds


class Scene:
    """Geoms, lights and camera of a picture, made anew for each set of poses.

    Attributes:
      extent: radius of what moves in one environment (m).
      places: (B, 3) where environments stand.
    """

    def __init__(self, model: mujoco.MjModel, envs: int, camera: Camera, com: bool):
        """Prepare a scene.

        Args:
          model: with its looks, of which some are changed.
          envs: how many environments stand side by side.
          camera: see `jaxsim.viz.film`.
          com: mark centres of mass, and draw bodies transparent.
        """
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self.extent, center = bounds(model, data)
        self.places = places(envs, self.extent)
        self._model, self._com = model, com
        _make_floors_endless(model)
        self._others = _without_planes(model) if envs > 1 else model
        self._stage = stage(
            model,
            envs,
            self.extent + float(np.ptp(self.places)) / 2,
            center + self.places.mean(0),
            data.xpos[min(1, model.nbody - 1), 2] - reach_of(model),
        )
        self._stage.prepare(model)
        self._camera = camera_of(model, camera, self.places)
        self._option, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._option.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = com
        self._mass = model.body_mass * np.isin(np.arange(model.nbody), moving_bodies(model))
        self._scene = mujoco.MjvScene(
            model, envs * (model.ngeom + model.nsite) + STAGE_GEOMS + _ROOM
        )

    def fill(
        self,
        data: Sequence[mujoco.MjData],
        contacts: Sequence[np.ndarray] = (),
        scale: float = 0.0,
    ) -> mujoco.MjvScene:
        """The scene of given poses.

        Args:
          data: of each environment, with its poses.
          contacts: of each environment, points and forces (n, 6), world axes (m, N).
          scale: length of an arrow for each newton (m/N).
        """
        scene, everything = self._scene, mujoco.mjtCatBit.mjCAT_ALL
        looks = self._option, self._perturb
        mujoco.mjv_updateScene(self._model, data[0], *looks, self._camera, everything, scene)
        for one, place in zip(data[1:], self.places[1:], strict=True):
            first = scene.ngeom
            mujoco.mjv_addGeoms(self._others, one, *looks, everything, scene)
            for geom in scene.geoms[first : scene.ngeom]:
                geom.pos += place
        self._stage.add(scene)
        if self._com and self._mass.any():
            for one, place in zip(data, self.places, strict=True):
                middle = self._mass @ one.xipos / self._mass.sum()
                add_center_of_mass(scene, middle + place, self.extent)
        for rows, place in zip(contacts, self.places, strict=bool(contacts)):
            placed = rows + np.append(place, np.zeros(3))
            add_contacts(scene, placed, scale, self.extent)
        return scene


def _without_planes(model: mujoco.MjModel) -> mujoco.MjModel:
    """One floor serves all environments, and must reach below all of them."""
    others = copy.copy(model)
    others.geom_group[model.geom_type == _PLANE] = _HIDDEN
    return others


def _make_floors_endless(model: mujoco.MjModel) -> None:
    """Floors are drawn without an end, as contacts have it; their tiles keep their size.

    MuJoCo repeats a material that is not `texuniform` over half of a plane, and over one unit of
    length where the plane has no end.
    """
    up = (model.geom_type == _PLANE) & (np.abs(model.geom_quat[:, 0]) > 0.999)
    for geom in np.nonzero(up)[0]:
        size, material = model.geom_size[geom, :2].copy(), model.geom_matid[geom]
        if not size.all():
            continue
        model.geom_size[geom, :2] = 0
        if material >= 0 and not model.mat_texuniform[material]:
            model.mat_texrepeat[material] /= size
