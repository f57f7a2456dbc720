"""Engine plugins of a compiled model: their names and attributes.

A compiled model has the place of each plugin in MuJoCo's registry, which depends on the order in
which the libraries were loaded, and the attributes as text, in the order of the plugin.
"""

import functools
from typing import NamedTuple

import mujoco

# Attributes of MuJoCo's own plugins, in their order.
ATTRIBUTES = {
    "mujoco.pid": "kp ki kd imax slewmax",
    "mujoco.elasticity.cable": "twist bend flat vmax",
    "mujoco.sensor.touch_grid": "nchannel size fov gamma",
    "mujoco.sdf.bolt": "radius",
    "mujoco.sdf.bowl": "height radius thickness",
    "mujoco.sdf.gear": "alpha diameter teeth thickness innerdiameter",
    "mujoco.sdf.nut": "radius",
    "mujoco.sdf.torus": "radius1 radius2",
}
SUPPORTED = frozenset({"mujoco.pid", "mujoco.elasticity.cable", "mujoco.sensor.touch_grid"})
# A model that uses a plugin, by the beginning of its name; others may be used by nothing.
_USES = {
    "mujoco.pid": """<worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>
        <actuator><plugin plugin="{}" joint="j"/></actuator>""",
    "mujoco.sensor": """<worldbody><site name="s"/></worldbody>
        <sensor><plugin plugin="{}" objtype="site" objname="s"><config key="size" value="1 1"/>
        <config key="fov" value="90 45"/></plugin></sensor>""",
}


class Plugin(NamedTuple):
    """An instance of a plugin: its name, empty if it is none of MuJoCo's own, and attributes."""

    name: str
    attributes: dict[str, str]


def plugins(mj: mujoco.MjModel) -> list[Plugin]:
    """The instances of plugins of a compiled model."""
    return [_instance(mj, i) for i in range(mj.nplugin)]


def numbers(text: str) -> list[float]:
    """The numbers in the value of an attribute."""
    return [number(word) for word in text.split()]


def number(text: str, default: float = 0.0) -> float:
    """The value of an attribute; the default if it has none, and 0 if it is no number."""
    try:
        return float(text) if text else default
    except ValueError:
        return 0.0


def _instance(mj: mujoco.MjModel, i: int) -> Plugin:
    name = _registry().get(int(mj.plugin[i]), "")
    text = bytes(mj.plugin_attr[mj.plugin_attradr[i] :].astype("uint8")).decode().split("\0")
    return Plugin(name, dict(zip(ATTRIBUTES.get(name, "").split(), text, strict=False)))


@functools.cache
def _registry() -> dict[int, str]:
    """Names of MuJoCo's own plugins by their places, read from models that use one each."""
    places = {}
    for name in ATTRIBUTES:
        use = next((xml for part, xml in _USES.items() if name.startswith(part)), "")
        instance = "" if use else '<instance name="i"/>'
        extension = f'<extension><plugin plugin="{name}">{instance}</plugin></extension>'
        try:
            mj = mujoco.MjModel.from_xml_string(f"<mujoco>{extension}{use.format(name)}</mujoco>")
        except ValueError:  # this MuJoCo does not have it
            continue
        places[int(mj.plugin[0])] = name
    return places
