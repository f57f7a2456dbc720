"""Sky, floor and light for models that bring none; they are drawn, and touch nothing."""

import dataclasses

import mujoco
import numpy as np

_SKY = (0.87, 0.91, 0.95, 1.0)
_FLOOR, _TILE = (0.82, 0.84, 0.87, 1.0), (0.76, 0.79, 0.83, 1.0)
# MuJoCo's shadow maps of 4096 take half of the time of a frame.
SHADOW_PIXELS = 1024
_TILES = 12  # on each side of the middle
_GROUNDS = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
# How many geoms `Stage.add` adds at most.
STAGE_GEOMS = 2 + 2 * (_TILES + 1) ** 2 + 2 * _TILES**2


@dataclasses.dataclass(frozen=True)
class Stage:
    """What a scene lacks.

    Attributes:
      sky: the model has no skybox, behind which MuJoCo draws nothing but black.
      sun: its lights shine on one environment only, and there are several; or it has none.
      floor: height of a floor (m); None where the model has one.
      extent: radius of what is shown (m).
      center: its middle.
    """

    sky: bool
    sun: bool
    floor: float | None
    extent: float
    center: np.ndarray

    def prepare(self, model: mujoco.MjModel) -> None:
        """Set the looks of a model that its scene takes over; before the first scene is made."""
        looks = model.vis
        looks.quality.shadowsize = min(looks.quality.shadowsize, SHADOW_PIXELS)
        if self.sun:
            # A directional light casts shadows within this many extents of its middle.
            looks.map.shadowclip = 2 * self.extent / model.stat.extent
        if self.sky or self.sun:
            looks.headlight.ambient[:] = np.maximum(looks.headlight.ambient, 0.35)
        if not self.sky:
            return
        looks.rgba.fog[:] = _SKY
        scale = self.extent / model.stat.extent
        looks.map.fogstart, looks.map.fogend = 8 * scale, 28 * scale
        looks.map.zfar = max(looks.map.zfar, 100 * scale)

    def add(self, scene: mujoco.MjvScene) -> None:
        """Add to a scene what it lacks."""
        # A white line where endless floors meet the sky.
        scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = False
        if self.floor is not None:
            self._add_floor(scene, self.floor)
        if self.sun:
            scene.nlight = min(scene.nlight, 1)  # the headlight
            _add_sun(scene, self.center, self.extent)
        if not self.sky:
            return
        # The far sphere is seen from inside, and takes no light.
        scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = False
        scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        sky = _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, 60 * self.extent, self.center, _SKY)
        sky.emission = 1.0

    def _add_floor(self, scene: mujoco.MjvScene, height: float) -> None:
        plane, tile = mujoco.mjtGeom.mjGEOM_PLANE, 10 ** np.round(np.log10(self.extent)) / 2
        middle = np.append(np.round(self.center[:2] / (2 * tile)) * 2 * tile, height)
        _add(scene, plane, 60 * self.extent, middle - np.array([0, 0, 2e-3 * self.extent]), _FLOOR)
        steps = np.arange(-_TILES, _TILES + 1)
        for i in steps:
            for j in steps[(i + steps) % 2 == 0]:
                _add(scene, plane, tile / 2, middle + np.array([i * tile, j * tile, 0]), _TILE)


def stage(
    model: mujoco.MjModel, envs: int, extent: float, center: np.ndarray, lowest: float
) -> Stage:
    """What scenes of a model lack.

    Args:
      model: the model with its looks.
      envs: how many environments are shown.
      extent: radius of what is shown (m).
      center: its middle.
      lowest: height that nothing shown goes below (m).
    """
    sky = not (model.tex_type == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)).any()
    has_ground = np.isin(model.geom_type, [int(g) for g in _GROUNDS]).any()
    # What is free would fall through a floor that is not there.
    free = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)).any()
    floor = None if has_ground or free else min(lowest, 0.0)
    sun = envs > 1 or model.nlight == 0
    return Stage(sky, sun, floor, extent, np.asarray(center))


def _add(scene: mujoco.MjvScene, kind, size: float, pos, rgba) -> mujoco.MjvGeom:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom, kind, np.full(3, size), np.asarray(pos, float), np.eye(3).ravel(), np.float32(rgba)
    )
    geom.category, geom.specular, geom.shininess = int(mujoco.mjtCatBit.mjCAT_STATIC), 0, 0
    scene.ngeom += 1
    return geom


def _add_sun(scene: mujoco.MjvScene, center: np.ndarray, extent: float) -> None:
    light, along = scene.lights[scene.nlight], np.array([0.35, 0.5, -1])
    light.type, light.texid = int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL), -1
    light.dir[:] = along / np.linalg.norm(along)
    light.pos[:] = center - extent * light.dir
    light.ambient[:], light.diffuse[:], light.specular[:] = 0, 0.6, 0.2
    light.attenuation[:] = [1, 0, 0]
    light.headlight, light.castshadow = 0, 1
    scene.nlight += 1
