"""Pictures: what is drawn has the poses of the model, and frames come out where OpenGL is there."""

import os
import subprocess
import sys

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.viz import Frames

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


def test_a_model_is_drawn_with_its_looks_and_its_present_sizes(bundled):
    source = bundled("humanoid")
    model = jaxsim.load(source)
    larger = model.replace(geom_size=1.5 * model.geom_size)
    drawing = Frames(larger)
    state = jaxsim.make_state(model).replace(
        qpos=jnp.asarray(source.qpos0 + 0.3 * np.sin(np.arange(source.nq)))
    )
    data = mujoco.MjData(source)
    data.qpos[:] = state.qpos
    mujoco.mj_kinematics(source, data)
    np.testing.assert_allclose(drawing.pose(state).geom_xpos, data.geom_xpos, atol=1e-5)
    drawn = drawing.model
    np.testing.assert_array_equal(drawn.geom_rgba, source.geom_rgba)
    floor = source.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    np.testing.assert_allclose(drawn.geom_size[~floor], 1.5 * source.geom_size[~floor], rtol=1e-6)


def test_floors_have_no_end_and_tiles_keep_their_size():
    """A tile of a plane of 4 m, repeated 8 times over half of it, is half a metre long."""
    xml = """<mujoco><asset><texture name="t" type="2d" builtin="checker" width="8" height="8"/>
      <material name="m" texture="t" texrepeat="8 8"/></asset>
      <worldbody><geom type="plane" size="4 2 1" material="m"/>
      <geom type="plane" size="4 2 1" euler="0 90 0"/></worldbody></mujoco>"""
    drawn = Frames(mujoco.MjModel.from_xml_string(xml)).model
    np.testing.assert_array_equal(drawn.geom_size[0], [0, 0, 1])
    np.testing.assert_allclose(drawn.mat_texrepeat[0], [2, 4])
    np.testing.assert_array_equal(drawn.geom_size[1], [4, 2, 1])  # a wall


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
