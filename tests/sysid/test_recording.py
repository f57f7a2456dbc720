"""Recordings from arrays and files, judged and cut into windows."""

import numpy as np
import pytest

import jaxsim
from jaxsim.sysid import Recording, SysidError, fit, read_csv, read_npz
from jaxsim.sysid.recording import admit_recordings, cut

CART = """
<mujoco><option timestep="0.01"/><worldbody><body>
  <joint name="x" type="slide" axis="1 0 0" damping="1"/><geom size=".1"/>
</body></worldbody><actuator><motor joint="x"/></actuator></mujoco>
"""


@pytest.fixture(scope="module")
def model():
    return jaxsim.load(CART)


def test_windows_hold_every_sample_once(model):
    qpos = np.arange(10.0)[:, None]
    (recording,) = admit_recordings(model, Recording(qpos, ctrl=10 + qpos[:9]))
    windows = cut(model, [recording], 4, 0.01)
    np.testing.assert_array_equal(windows.qpos[..., 0], [[0, 1, 2, 3], [4, 5, 6, 7], [6, 7, 8, 9]])
    np.testing.assert_array_equal(windows.weight, [[1, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1]])
    np.testing.assert_array_equal(windows.ctrl[..., 0], windows.qpos[:, :3, 0] + 10)
    np.testing.assert_allclose(windows.qvel, 100, rtol=1e-5)  # differences
    assert not windows.has_qvel.any()
    assert cut(model, [recording], None, 0.01).qpos.shape == (1, 10, 1)


def test_files(tmp_path):
    rng = np.random.default_rng(0)
    arrays = {"qpos": rng.normal(size=(3, 5, 2)), "ctrl": rng.normal(size=(3, 4, 1))}
    np.savez(tmp_path / "batch.npz", **arrays)
    found = read_npz(tmp_path / "batch.npz")
    assert len(found) == 3
    np.testing.assert_array_equal(found[1].qpos, arrays["qpos"][1])
    assert found[1].qvel is None
    (tmp_path / "log.csv").write_text("time,qpos_1,qpos_0,ctrl_0\n0,1,2,3\n1,4,5,6\n")
    log = read_csv(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.qpos, [[2, 1], [5, 4]])
    np.testing.assert_array_equal(log.ctrl, [[3], [6]])
    (tmp_path / "bad.csv").write_text("qpos_0\n1\nx\n")
    with pytest.raises(SysidError, match="'x' where a number"):
        read_csv(tmp_path / "bad.csv")
    (tmp_path / "empty.csv").write_text("time\n1\n")
    with pytest.raises(SysidError, match="no columns qpos_0"):
        read_csv(tmp_path / "empty.csv")


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        ([], "no recordings"),
        ([np.zeros((5, 1))], "no jaxsim.sysid.Recording"),
        (Recording(np.zeros((5, 2))), r"qpos must have shape \(5, 1\)"),
        (Recording(np.zeros((5, 1)), np.zeros((3, 1))), r"ctrl must have shape \(4, 1\)"),
        (Recording(np.zeros((5, 1)), qvel=np.zeros((4, 1))), r"qvel must have shape \(5, 1\)"),
        (Recording(np.full((5, 1), np.nan)), "not finite"),
        (Recording(np.zeros((1, 1))), "fewer than two samples"),
    ],
)
def test_wrong_recordings_are_told(model, recording, message):
    with pytest.raises(SysidError, match=message):
        fit(model, recording, ["dof_damping[x]"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": 0}, "starts must be a positive integer"),
        ({"window": 1}, "two samples"),
        ({"noise": (0.0, 1.0)}, "positive standard deviations"),
        ({"method": "newton"}, "method must be"),
    ],
)
def test_wrong_options_are_told(model, options, message):
    with pytest.raises(SysidError, match=message):
        fit(model, Recording(np.zeros((5, 1))), ["dof_damping[x]"], **options)
