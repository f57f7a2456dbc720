"""Pictures: the scene has the poses of the model, and frames come out where OpenGL is there."""

import os
import subprocess
import sys

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.viz import Frames, scene

FRAME = """
import jaxsim, numpy as np
from jaxsim.viz import Frames
model = jaxsim.load({model!r})
drawing = Frames(model, width=64, height=48)
frame = drawing.frame(jaxsim.make_state(model))
assert frame.shape == (48, 64, 3) and frame.dtype == np.uint8 and frame.std() > 1
drawing.close()
assert drawing.frame(jaxsim.make_state(model)).shape == (48, 64, 3)
drawing.close()
"""


@pytest.mark.parametrize("name", ["humanoid", "arm", "spheres", "four_bar", "box_on_plane"])
def test_the_scene_has_the_poses_of_the_model(name, bundled):
    source = bundled(name)
    drawn = scene(jaxsim.load(source))
    assert (drawn.nq, drawn.nbody, drawn.ngeom) == (source.nq, source.nbody, source.ngeom)
    poses = []
    for model in (source, drawn):
        data = mujoco.MjData(model)
        data.qpos[:] = source.qpos0 + 0.3 * np.sin(np.arange(source.nq))
        mujoco.mj_kinematics(model, data)
        poses.append((data.xpos, data.geom_xpos, data.geom_xmat))
    for theirs, ours in zip(*poses, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5)


def test_positions_of_reference_are_kept():
    """A hinge with a reference: at qpos = ref the body is where the file puts it."""
    xml = """<mujoco><compiler angle="radian"/><worldbody><body pos="0 0 1">
      <joint axis="0 1 0" ref="0.7"/><geom size="0.1" pos="1 0 0"/></body></worldbody></mujoco>"""
    drawn = scene(jaxsim.load(xml))
    data = mujoco.MjData(drawn)
    data.qpos[:] = 0.7
    mujoco.mj_kinematics(drawn, data)
    np.testing.assert_allclose(data.geom_xpos[0], [1, 0, 1], atol=1e-6)


def test_mocap_bodies_move():
    xml = """<mujoco><worldbody><body mocap="true" pos="1 2 3"><geom size="0.1"/></body>
      <body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>"""
    model = jaxsim.load(xml)
    state = jaxsim.make_state(model).replace(mocap_pos=jnp.array([[4.0, 5, 6]]))
    np.testing.assert_array_equal(Frames(model).pose(state).xpos[1], [4, 5, 6])


def test_draws_or_says_what_is_missing():
    code = FRAME.format(model="humanoid")
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "MUJOCO_GL": "egl"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0 or "MUJOCO_GL=egl" in done.stderr, done.stderr


def test_without_opengl_the_error_says_what_to_do():
    done = subprocess.run(
        [sys.executable, "-c", FRAME.format(model="pendulum")],
        env={**os.environ, "MUJOCO_GL": "disable"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode != 0
    assert "start Python with MUJOCO_GL=egl" in done.stderr


def test_mistakes_are_named(bundled):
    with pytest.raises(ValueError, match="must be positive"):
        Frames(bundled("pendulum"), width=0)
    with pytest.raises(ValueError, match="there is no camera 'nose'"):
        Frames(bundled("pendulum"), camera="nose")
    with pytest.raises(ValueError, match="there is no camera 7"):
        Frames(bundled("pendulum"), camera=7)
