"""Our model files of the locomotion tasks compile to the same numbers as Gymnasium's."""

import mujoco
import numpy as np
import pytest
from test_classic_models import ASSETS, OURS, _physics

NAMES = {
    "ant": "ant",
    "half_cheetah": "half_cheetah",
    "hopper": "hopper",
    "humanoid": "humanoid",
    "humanoid_standup": "humanoidstandup",
    "walker2d": "walker2d_v5",
}


@pytest.mark.parametrize("name", NAMES)
def test_compiled_model_is_gymnasiums(name):
    ours = mujoco.MjModel.from_xml_path(str(OURS / f"{name}.xml"))
    theirs = mujoco.MjModel.from_xml_path(str(ASSETS / f"{NAMES[name]}.xml"))
    fields = _physics(ours)
    for field, value in _physics(theirs).items():
        if not field.startswith("key_"):  # humanoids reserve five keyframes and leave them empty
            np.testing.assert_allclose(fields[field], value, rtol=1e-13, atol=1e-14, err_msg=field)
    np.testing.assert_allclose(ours.stat.meaninertia, theirs.stat.meaninertia, rtol=1e-13)


@pytest.mark.parametrize("name", NAMES)
def test_names_are_gymnasiums(name):
    ours = mujoco.MjModel.from_xml_path(str(OURS / f"{name}.xml"))
    theirs = mujoco.MjModel.from_xml_path(str(ASSETS / f"{NAMES[name]}.xml"))
    for kind in ("body", "joint", "geom", "actuator", "tendon"):
        count = {"joint": "njnt", "actuator": "nu"}.get(kind, f"n{kind}")
        for i in range(getattr(theirs, count)):
            name = getattr(theirs, kind)(i).name
            assert name in ("", getattr(ours, kind)(i).name)
