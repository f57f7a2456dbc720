"""Files of simulations: what was written is read, and what is none is refused."""

import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.viz import html, load_trajectory, save_trajectory

BALL = """
<mujoco><worldbody><body name="ball"><freejoint/><geom size=".1" rgba="1 0 0 1"/></body>
</worldbody></mujoco>
"""


def states(steps: int) -> jaxsim.State:
    """A ball that moves along x."""
    one = jaxsim.make_state(jaxsim.load(BALL))
    qpos = np.tile(np.asarray(one.qpos), (steps, 1))
    qpos[:, 0] = np.arange(steps)
    zeros = {name: np.zeros((steps, 6)) for name in ("qvel", "qacc_warmstart", "qfrc_applied")}
    empty = {"act": (0,), "xfrc_applied": (2, 6), "mocap_pos": (0, 3), "mocap_quat": (0, 4)}
    zeros |= {name: np.zeros((steps, *shape)) for name, shape in empty.items()}
    return one.replace(qpos=qpos, time=0.01 * np.arange(steps), time_excess=None, **zeros)


def test_what_was_written_is_read(tmp_path):
    model, trajectory = jaxsim.load(BALL), states(4)
    path = save_trajectory(tmp_path / "run", model, trajectory)
    assert path.name == "run.npz"
    found, again = load_trajectory(path)
    assert mujoco.mj_id2name(found, mujoco.mjtObj.mjOBJ_BODY, 1) == "ball"
    for name in ("qpos", "qvel", "time"):
        np.testing.assert_array_equal(getattr(again, name), getattr(trajectory, name))
    assert len(html(found, again).text) > 1000


def test_other_files_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", qpos=np.zeros(3))
    with pytest.raises(ValueError, match=r"other.npz is no file of jaxsim.viz.save_trajectory"):
        load_trajectory(tmp_path / "other.npz")
    with pytest.raises(ValueError, match="must have shape"):
        save_trajectory(tmp_path / "x", jaxsim.load(BALL), jaxsim.make_state(jaxsim.load(BALL)))
