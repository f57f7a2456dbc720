"""Two-geom scenes and MuJoCo's contacts in them."""

import mujoco
import numpy as np
import pytest
from pair_sizes import WEDGE, geom

MARGIN = 0.03


@pytest.fixture(autouse=True)
def _double(x64):
    """Everything about collision is compared in float64 unless a test says otherwise."""


@pytest.fixture
def two_geoms():
    """Function from two geom types to a model: a mocap body and a free body with one geom each."""

    def build(type1: str, type2: str) -> mujoco.MjModel:
        geoms = [geom(t, MARGIN / 2) for t in (type1, type2)]
        return mujoco.MjModel.from_xml_string(
            f"""<mujoco><asset><mesh name="wedge" vertex="{WEDGE}"/></asset>
            <worldbody><body mocap="true">{geoms[0]}</body>
            <body><freejoint/>{geoms[1]}</body></worldbody></mujoco>"""
        )

    return build


@pytest.fixture
def contacts_of():
    """Function from a model and a qpos to MuJoCo's data after its collision stage."""

    def run(model: mujoco.MjModel, qpos: np.ndarray, mocap=None) -> mujoco.MjData:
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        if mocap is not None:
            data.mocap_pos[0], data.mocap_quat[0] = mocap[:3], mocap[3:]
        mujoco.mj_fwdPosition(model, data)
        return data

    return run
