"""Our model files of the classic tasks compile to the same numbers as Gymnasium's."""

import pathlib

import gymnasium
import mujoco
import numpy as np
import pytest

import jaxsim

NAMES = ("inverted_pendulum", "inverted_double_pendulum", "reacher", "swimmer")
ASSETS = pathlib.Path(gymnasium.__file__).parent / "envs/mujoco/assets"
OURS = pathlib.Path(jaxsim.__file__).parent / "assets"
PHYSICS = tuple(
    "body jnt dof geom site tendon actuator eq pair exclude sensor qpos opt key wrap".split()
)
# What only the renderer reads, and how names are stored.
LOOKS = ("rgba", "matid", "group", "adr", "signature", "plugin", "user", "dataid", "mesh", "bvh")


def _physics(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    fields = {n: getattr(mj, n) for n in dir(mj) if n.startswith(PHYSICS) and "_" in n}
    fields |= {f"opt.{n}": getattr(mj.opt, n) for n in dir(mj.opt) if not n.startswith("_")}
    return {
        name: value
        for name, value in fields.items()
        if isinstance(value, (int, float, np.ndarray)) and not any(x in name for x in LOOKS)
    }


@pytest.mark.parametrize("name", NAMES)
def test_compiled_model_is_gymnasiums(name):
    ours = _physics(mujoco.MjModel.from_xml_path(str(OURS / f"{name}.xml")))
    theirs = _physics(mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml")))
    assert len(ours) > 100
    for field, value in theirs.items():
        np.testing.assert_allclose(ours[field], value, rtol=1e-14, atol=1e-15, err_msg=field)
