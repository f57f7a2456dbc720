"""Which of MuJoCo's features are supported.

Every feature that affects MuJoCo's physics and is not supported is reported: nothing is ignored
silently. Rendering data (lights, materials, visual meshes) is allowed. Messages use MJCF's
names. A constant without a name comes from a later MuJoCo and is reported, too.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from jaxsim.collision.distance import DISTANCE_SENSORS, distance_problems, measured_pairs
from jaxsim.collision.rays import opaque_geoms, ray_problems
from jaxsim.collision.table import type_name
from jaxsim.io.cables import unsupported_bodies
from jaxsim.io.pid_controllers import unsupported_controllers
from jaxsim.io.touch_grids import unsupported_grids
from jaxsim.model.enums import constant_name
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem
from jaxsim.sensor import SENSORS

_ENABLE_FLAGS = "OVERRIDE ENERGY FWDINV INVDISCRETE SLEEP DIAGEXACT"
# MJCF's names that differ from MuJoCo's names of constants.
_MJCF_NAMES = {
    "geomdist": "distance",
    "geomnormal": "normal",
    "geomfromto": "fromto",
    "slidercrank": "cranksite",
}


class _Choice(NamedTuple):
    """A field with values of a MuJoCo enum, of which some are supported."""

    field: str
    kind: str
    attribute: str
    enum: str
    supported: str


_CHOICES = (
    _Choice("jnt_type", "joint", "type", "mjtJoint", "FREE BALL SLIDE HINGE"),
    _Choice(
        *("actuator_trntype", "actuator", "transmission", "mjtTrn"),
        "JOINT JOINTINPARENT SLIDERCRANK TENDON SITE BODY SO3",
    ),
    _Choice(
        *("actuator_dyntype", "actuator", "dyntype", "mjtDyn"),
        "NONE INTEGRATOR FILTER FILTEREXACT MUSCLE DCMOTOR PID",
    ),
    _Choice(
        *("actuator_gaintype", "actuator", "gaintype", "mjtGain"),
        "FIXED AFFINE MUSCLE DCMOTOR SO3 PID",
    ),
    _Choice(
        *("actuator_biastype", "actuator", "biastype", "mjtBias"),
        "NONE AFFINE MUSCLE DCMOTOR SO3",
    ),
    _Choice("eq_type", "equality", "type", "mjtEq", "CONNECT WELD JOINT TENDON"),
)
_OPTIONS = (
    _Choice(
        "integrator", "option", "integrator", "mjtIntegrator", "EULER RK4 IMPLICIT IMPLICITFAST"
    ),
    _Choice("cone", "option", "cone", "mjtCone", "PYRAMIDAL ELLIPTIC"),
)


def unsupported(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """All unsupported features that a compiled model uses, each with a remedy."""
    yield from _options(mj)
    for choice in _CHOICES:
        for i, value in enumerate(getattr(mj, choice.field)):
            yield from _chosen(choice, label(choice.kind, i), value)
    yield from _sensors(mj, label)
    yield from unsupported_grids(mj, label)
    yield from unsupported_bodies(mj, label)
    yield from unsupported_controllers(mj, label)
    yield from _geometry(mj, label)


def _mjcf(constant: str) -> str:
    return _MJCF_NAMES.get(constant.lower(), constant.lower())


def _chosen(choice: _Choice, who: str, value: int) -> Iterator[ModelProblem]:
    name = constant_name(choice.enum, value)
    if name not in choice.supported.split():
        known = ", ".join(choice.supported.lower().split())
        yield ModelProblem(
            who, f"{choice.attribute} {_mjcf(name)!r} is not supported; use one of {known}"
        )


def _options(mj: mujoco.MjModel) -> Iterator[ModelProblem]:
    for choice in _OPTIONS:
        yield from _chosen(choice, "option", getattr(mj.opt, choice.field))
    flags = int(mj.opt.enableflags)
    for bit in (1 << k for k in range(flags.bit_length()) if flags >> k & 1):
        name = constant_name("mjtEnableBit", bit)
        if name not in _ENABLE_FLAGS.split():
            yield ModelProblem("option flag", f"{name.lower()} is not supported; disable it")
    if mj.nflex:
        yield ModelProblem("", "flex elements are not supported; remove them from the model")


def _geometry(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Geoms without a distance that is measured, or that range finders cannot see."""
    for s in np.flatnonzero(np.isin(mj.sensor_type, DISTANCE_SENSORS)):
        for geom in distance_problems(mj, measured_pairs(mj, int(s))):
            yield ModelProblem(
                label("sensor", int(s)),
                f"no distance can be measured to {label('geom', geom)}, a "
                f"{type_name(mj.geom_type[geom])}; remove it",
            )
    if mujoco.mjtSensor.mjSENS_RANGEFINDER in mj.sensor_type:
        for geom in ray_problems(mj, opaque_geoms(mj)):
            yield ModelProblem(
                label("geom", geom),
                f"range finders cannot see {type_name(mj.geom_type[geom])}; make it transparent",
            )


def _sensors(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    for s in range(mj.nsensor):
        name = constant_name("mjtSensor", mj.sensor_type[s])
        if name not in SENSORS:
            yield ModelProblem(
                label("sensor", s),
                f"type {_mjcf(name)!r} is not supported; remove it, the documentation's table of "
                "sensors lists the supported types",
            )
