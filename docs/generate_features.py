"""Writes `docs/features.md`: what MuJoCo has, and whether jaxsim and MJX have it.

The columns are what the loaders themselves know: `jaxsim.io.supported`, the tables of sensors and
of pairs of shapes, and MJX's enumerations. Run `python docs/generate_features.py` after adding a
feature; a test compares. MJX is read from the package `mujoco-mjx`, in the extra `bench`.
"""

import itertools
import pathlib

import mujoco
from mujoco.mjx._src import collision_driver
from mujoco.mjx._src import types as mjx

from jaxsim.collision.table import PAIRS, type_name
from jaxsim.io import plugins, supported
from jaxsim.model.enums import constant_name
from jaxsim.sensor import SENSORS

PAGE = pathlib.Path(__file__).parent / "features.md"
HEAD = """\
# Features beside MuJoCo and MJX

<!-- Written by docs/generate_features.py from what the loaders know; change it there. -->

Each row is one of MuJoCo {version}'s own constants. [What a model may ask for](support.md) says
more about each; what a loader does not know is an error when the model is loaded, in jaxsim and
in MJX.
"""
# MuJoCo's enumeration, MJX's of the same, and what it is called here.
TITLES = {
    "mjtJoint": ("JointType", "Joints"),
    "mjtTrn": ("TrnType", "Transmissions of actuators"),
    "mjtDyn": ("DynType", "Dynamics of actuators"),
    "mjtGain": ("GainType", "Gains of actuators"),
    "mjtBias": ("BiasType", "Biases of actuators"),
    "mjtEq": ("EqType", "Equality constraints"),
    "mjtIntegrator": ("IntegratorType", "Integrators"),
    "mjtCone": ("ConeType", "Friction cones"),
}
_SHAPES = "PLANE HFIELD SPHERE CAPSULE ELLIPSOID CYLINDER BOX MESH SDF"


def page() -> str:
    """The text of the page."""
    parts = [HEAD.format(version=mujoco.__version__)]
    for choice in (*supported._CHOICES, *supported._OPTIONS):
        theirs, title = TITLES[choice.enum]
        rows = _rows(choice.enum, choice.supported.split(), _names(getattr(mjx, theirs)))
        parts.append(_table(title, rows))
    sensors = list(SENSORS)
    parts.append(_table("Sensors", _rows("mjtSensor", sensors, _names(mjx.SensorType))))
    named = [(name, name in plugins.SUPPORTED, False) for name in plugins.ATTRIBUTES]
    parts.append(_table("Engine plugins", named))
    parts.append(_table("Pairs of shapes that collide", _pairs()))
    return "\n".join(parts)


def _names(enum) -> set[str]:
    return {member.name for member in enum}


def _rows(enum: str, ours, theirs) -> list[tuple[str, bool, bool]]:
    members = sorted({int(v) for v in getattr(mujoco, enum).__members__.values()})
    names = [constant_name(enum, value) for value in members]
    unused = ({"UNDEFINED", "USER", "CONTACT"} - set(ours)) | {"PLUGIN"}
    return [(n.lower(), n in ours, n in theirs) for n in names if n not in unused]


def _pairs() -> list[tuple[str, bool, bool]]:
    kinds = [int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in _SHAPES.split()]
    ours = {tuple(sorted(pair)) for pair in PAIRS}
    theirs = {tuple(sorted(map(int, pair))) for pair in collision_driver._COLLISION_FUNC}
    return [
        (f"{type_name(a)}, {type_name(b)}", (a, b) in ours, (a, b) in theirs)
        for a, b in itertools.combinations_with_replacement(kinds, 2)
        if (a, b) in ours or (a, b) in theirs
    ]


def _table(title: str, rows) -> str:
    head = f"## {title}\n\n| | jaxsim | MJX |\n| --- | --- | --- |\n"
    mark = {True: "yes", False: "no"}
    return head + "".join(f"| {name} | {mark[a]} | {mark[b]} |\n" for name, a, b in rows)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
