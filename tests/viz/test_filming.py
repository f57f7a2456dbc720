"""Films: which states they show, what is marked, and what a model without looks gets."""

import imageio.v3 as imageio
import jax
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.viz import Frames, film
from jaxsim.viz.filming import frames_at
from jaxsim.viz.scene import Scene
from jaxsim.viz.touch import Touch, metres_per_newton
from jaxsim.viz.video import write_video

BARE = """
<mujoco>
  <worldbody>
    <body name="a" pos="0 0 1"><joint type="hinge" axis="0 1 0"/><geom size=".1" mass="2"/>
      <body pos="0 0 -.5"><joint type="slide"/><geom size=".1" mass="1"/></body></body>
  </worldbody>
</mujoco>
"""
FLOOR = '<geom type="plane" size="1 1 .1"/><light pos="0 0 3"/>'
FULL = BARE.replace("<worldbody>", f"<worldbody>{FLOOR}")
SKY = '<asset><texture type="skybox" builtin="flat" width="8" height="8"/></asset>'


def scene(xml: str, envs: int = 1, com: bool = False):
    """A scene, and the data that it shows."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Scene(model, envs, None, com), data


def geoms(filled: mujoco.MjvScene, kind) -> list[mujoco.MjvGeom]:
    """Geoms of one type."""
    return [geom for geom in filled.geoms[: filled.ngeom] if geom.type == int(kind)]


def test_a_frame_shows_the_last_state_before_its_time():
    times = np.array([0.0, 0.01, 0.02, 0.03, 0.04])
    np.testing.assert_array_equal(frames_at(times, 0.02), [0, 2, 4])
    np.testing.assert_array_equal(frames_at(times, 0.005), [0, 0, 1, 1, 2, 2, 3, 3, 4])
    np.testing.assert_array_equal(frames_at(times[:1], 0.02), [0])


def test_what_a_model_lacks_is_added_to_the_picture_only():
    bare, data = scene(BARE)
    filled = bare.fill([data])
    assert filled.nlight == 2  # one is the headlight
    assert geoms(filled, mujoco.mjtGeom.mjGEOM_PLANE)
    spheres = geoms(filled, mujoco.mjtGeom.mjGEOM_SPHERE)
    assert max(s.size[0] for s in spheres) > 10 * bare.extent  # the sky
    assert min(p.pos[2] for p in geoms(filled, mujoco.mjtGeom.mjGEOM_PLANE)) < 1 - 0.6
    whole, data = scene(FULL.replace("<worldbody>", f"{SKY}<worldbody>"))
    filled = whole.fill([data])
    assert len(geoms(filled, mujoco.mjtGeom.mjGEOM_PLANE)) == 1
    assert len(geoms(filled, mujoco.mjtGeom.mjGEOM_SPHERE)) == 2


def test_environments_stand_apart_on_one_floor():
    field, data = scene(FULL, envs=3)
    filled = field.fill([data] * 3)
    assert len(geoms(filled, mujoco.mjtGeom.mjGEOM_PLANE)) == 1
    small = [g for g in geoms(filled, mujoco.mjtGeom.mjGEOM_SPHERE) if g.size[0] < 1]
    assert len(small) == 6
    apart = np.array([small[2 * i].pos - small[0].pos for i in range(3)])
    np.testing.assert_allclose(apart, field.places, atol=1e-6)
    assert np.linalg.norm(apart[1]) > 2 * field.extent


def test_marks_stand_where_they_belong():
    one, data = scene(FULL, com=True)
    force = np.array([[0.1, 0.2, 0.0, 0, 0, 10.0]])
    filled = one.fill([data], [force], scale=0.05)
    middle = (2 * data.xipos[1] + data.xipos[2]) / 3
    balls = geoms(filled, mujoco.mjtGeom.mjGEOM_SPHERE)
    assert any(np.allclose(ball.pos, middle, atol=1e-6) for ball in balls)
    (arrow,) = geoms(filled, mujoco.mjtGeom.mjGEOM_ARROW)
    np.testing.assert_allclose(arrow.pos, force[0, :3], atol=1e-6)
    np.testing.assert_allclose(arrow.mat[:, 2], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(arrow.size[2], 0.5, rtol=1e-6)


def test_arrows_are_scaled_by_the_median_force():
    rows = np.zeros((3, 6))
    rows[:, 3] = [1, 4, 100]
    assert metres_per_newton([Touch(np.array([0, 3]), rows)], extent=2.0) == pytest.approx(0.2)
    assert metres_per_newton([], 1.0) == 0


def test_a_gif_has_the_pictures(tmp_path):
    frames = [np.full((32, 48, 3), i * 40, np.uint8) for i in range(5)]
    path = write_video(frames, tmp_path / "new" / "run.gif", fps=25)
    np.testing.assert_allclose(imageio.imread(path, index=None)[..., :3], frames, atol=8)
    with pytest.raises(ValueError, match=r"a \.mp4 or a \.gif"):
        write_video(frames, tmp_path / "run.avi", 25)


def test_a_film_of_a_batch(tmp_path):
    model = jaxsim.load(FULL)
    state = jaxsim.make_state(model)
    states = jax.tree.map(lambda x: np.stack([np.asarray(x)] * 6), state)
    states = states.replace(time=np.linspace(0, 0.2, 6))
    batch = jax.tree.map(lambda x: np.stack([x, x]), states)
    try:
        path = film(
            model, batch, tmp_path / "run.gif", fps=20, com=True, label="two", width=64, height=48
        )
    except RuntimeError as error:
        pytest.skip(str(error))  # nothing to draw with
    assert imageio.imread(path, index=None).shape[1:3] == (48, 64)
    with pytest.raises(ValueError, match="label must be one text, or 6"):
        film(model, states, path, label=["a"])
    with pytest.raises(ValueError, match="must be positive"):
        film(model, states, path, fps=0)


def test_the_users_model_keeps_its_looks():
    model = mujoco.MjModel.from_xml_string(BARE)
    before = model.vis.headlight.ambient.copy()
    assert Frames(model).model.vis.headlight.ambient[0] > before[0]
    np.testing.assert_array_equal(model.vis.headlight.ambient, before)
