"""Rods of 1:320 to 1:440 in float32, where contacts are stiffer than the inertia by 1e6."""

import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint.contact_rows import contact_rows

XML = """
<mujoco>
  <option impratio="{impratio}" gravity="1.2 -.3 -9.81" tolerance="0"/>
  <worldbody>
    <geom type="plane" size="0 0 1" friction="0 0 0"/>
    <body><freejoint/><geom type="capsule" size="{size}" mass="{mass}" friction="{friction}"
        solref="{solref} 1"/></body>
  </worldbody>
</mujoco>
"""
# (parameters, pose, velocity): spinning about their axes, on one or both ends. The second solve
# passes through a corner between zones, where steps gain less than rounding before one gains much.
ROD = {"impratio": 15.4, "size": ".0007 .31", "mass": 0.287, "friction": 0.0216, "solref": 0.0192}
WIRE = {"impratio": 8.14, "size": ".0003 .098", "mass": 0.459, "friction": 0.0112, "solref": 0.0058}
CASES = {
    "wire": (
        WIRE,
        (0, 0, 2.92982702e-4, -0.628941894, -0.628755331, 0.323391765, -0.32329008),
        (-0.337245584, -0.274419993, 0.00472182408, 0.00966162421, -0.00989882462, 206.400925),
    ),
    "deep": (
        ROD,
        (0, 0, -0.01330073, 0.06515475, 0.22724108, 0.67046863, -0.70326954),
        (0.524263382, -0.144697741, 0.357843101, -4.39645481, 5.49012184, 213.051758),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_accelerations_of_slender_bodies(name, x32):
    """Those of MuJoCo; a hundredth of the fastest is what the rounding of the state leaves."""
    parameters, qpos, qvel = CASES[name]
    mj = mujoco.MjModel.from_xml_string(XML.format(**parameters))
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(mj, data)
    assert data.ncon
    model = jaxsim.load(mj)
    state = jaxsim.make_state(model).replace(
        qpos=np.float32(data.qpos), qvel=np.float32(data.qvel), qacc_warmstart=np.zeros(6, "f4")
    )
    found = quick_jit(lambda state: jaxsim.forward(model, state))(state)
    np.testing.assert_allclose(found.qacc, data.qacc, atol=0.01 * np.abs(data.qacc).max())
    np.testing.assert_allclose(found.qacc[:3], data.qacc[:3], rtol=1e-2, atol=2e-2)


def test_stiffness_in_own_axes_keeps_its_rank(x32, rng):
    """A body feels nothing about its axis of a force through it, however stiff and far away."""
    frame = np.linalg.qr(rng.normal(size=(5, 3, 3)))[0].astype("f4")
    arms = (3.0 * frame[:, 0]).astype("f4")  # the normals pass through the reference point
    links = np.zeros(5, int)
    rows = contact_rows(frame, 3, (arms, arms), (links - 1, links)).turned(
        np.linalg.qr(rng.normal(size=(1, 3, 3)))[0].astype("f4")
    )
    weight = np.zeros((5, 3, 3), "f4")
    weight[:, 0, 0] = 1e5
    _, matrix = rows.add_curvature(weight, np.zeros(6, "f4"), np.zeros((1, 6, 6), "f4"))
    assert np.abs(matrix[0, :3, :3]).max() < 1e-6
    assert np.linalg.eigvalsh(np.float64(matrix[0, 3:, 3:])).max() > 1e4
