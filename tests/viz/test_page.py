"""The page of `jaxsim.viz.html`: what it holds, and that a browser shows bodies where they are."""

import base64
import json
import re
import shutil
import subprocess

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.viz import html

SCENE = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  .4 0 0  0 .4 0  0 0 .4"/>
    <hfield name="hill" nrow="3" ncol="4" size="2 1 .5 .1" elevation="0 0 0 0  0 1 1 0  0 0 0 0"/>
    <material name="red" rgba="1 0 0 1"/>
  </asset>
  <worldbody>
    <geom type="hfield" hfield="hill" pos="0 0 -1"/>
    <geom type="box" size=".1 .2 .3" pos="1 0 0" group="3"/>
    <body name="a" pos="0 0 1"><freejoint/>
      <geom type="mesh" mesh="wedge" material="red"/>
      <body name="b" pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".05 .2"/></body>
    </body>
    <body name="m" mocap="true"><geom type="sphere" size=".1" rgba="0 1 0 .5"/></body>
  </worldbody>
</mujoco>
"""
BALL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .1"><freejoint/><geom size=".1" mass="2"/></body>
  </worldbody>
</mujoco>
"""


def record(page) -> dict:
    """The data of a page, with its numbers in place of where they stand."""
    text = re.search(r'<script id="data"[^>]*>(.*?)</script>', page.text, re.DOTALL)[1]
    data = json.loads(text.replace("<\\/", "</"))
    numbers = np.frombuffer(base64.b64decode(data["numbers"]), "<f4")
    data["at"] = lambda range_: numbers[range_[0] : sum(range_)]
    return data


def moved(model: mujoco.MjModel, rng, *shape: int) -> jaxsim.State:
    """States with random coordinates."""
    data = mujoco.MjData(model)
    one = {
        "qpos": np.array(data.qpos),
        "qvel": np.array(data.qvel),
        "act": np.array(data.act),
        "time": np.zeros(()),
        "qacc_warmstart": np.array(data.qvel),
        "xfrc_applied": np.array(data.xfrc_applied),
        "qfrc_applied": np.array(data.qvel),
        "mocap_pos": np.array(data.mocap_pos),
        "mocap_quat": np.array(data.mocap_quat),
    }
    state = jaxsim.make_state(jaxsim.load(BALL)).replace(**one)
    states = jax.tree.map(lambda x: np.broadcast_to(x, (*shape, *np.shape(x))).copy(), state)
    qpos = states.qpos + rng.normal(size=states.qpos.shape)
    time = np.broadcast_to(0.01 * np.arange(shape[-1]), shape)
    return states.replace(qpos=qpos, time=time, mocap_pos=states.mocap_pos + 1)


def test_poses_are_those_of_mujoco(rng):
    model = mujoco.MjModel.from_xml_string(SCENE)
    states = moved(model, rng, 2, 5)
    data = record(html(model, states))
    assert data["moving"] == [1, 2, 3]
    assert len(data["poses"]) == 2
    np.testing.assert_allclose(data["at"](data["times"]), 0.01 * np.arange(5), rtol=1e-6)
    oracle = mujoco.MjData(model)
    for env in range(2):
        poses = data["at"](data["poses"][env]).reshape(5, 3, 7)
        for t in range(5):
            oracle.qpos[:], oracle.mocap_pos[:] = states.qpos[env, t], states.mocap_pos[env, t]
            mujoco.mj_kinematics(model, oracle)
            np.testing.assert_allclose(poses[t, :, :3], oracle.xpos[1:], atol=1e-6)
            np.testing.assert_allclose(poses[t, :, [6, 3, 4, 5]].T, oracle.xquat[1:], atol=1e-6)
        com = data["at"](data["com"][env]).reshape(5, 3)
        mass = model.body_mass[1:, None]
        mujoco.mj_comPos(model, oracle)
        np.testing.assert_allclose(
            com[-1], (mass * oracle.xipos[1:]).sum(0) / mass.sum(), atol=1e-5
        )


def test_shapes_have_their_looks_and_surfaces(rng):
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = record(html(model, moved(model, rng, 1)))
    types = [(geom["type"], geom["slot"]) for geom in data["geoms"]]
    assert types == [("surface", -1), ("surface", 0), ("capsule", 1), ("sphere", 2)]
    assert data["geoms"][1]["rgba"] == [1, 0, 0, 1]  # the material's
    assert data["geoms"][3]["rgba"] == [0, 1, 0, 0.5]
    hill, wedge = data["surfaces"]
    points = data["at"](hill["points"]).reshape(-1, 3)
    assert points.max(0).tolist() == [2, 1, 0.5]
    assert len(data["at"](hill["faces"])) == 3 * 2 * 2 * 3
    assert len(data["at"](wedge["faces"])) == 3 * 4
    # A mesh geom's frame is that of its inertia: its corners are where the file has them.
    corners = data["at"](wedge["points"]).reshape(-1, 3)
    turned = np.array([_rotated(model.geom_quat[2], p) for p in corners]) + model.geom_pos[2]
    assert sorted(turned.round(5).max(0).tolist()) == [0.4, 0.4, 0.4]


def _rotated(quat, vector):
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, np.asarray(vector, float), quat)
    return out


def test_contact_forces_carry_the_weight():
    model = jaxsim.load(BALL)
    state = jaxsim.make_state(model)
    _, trajectory = jax.jit(jaxsim.rollout)(model, state, jnp.zeros((300, 0)))
    data = record(html(model, trajectory, contacts=True, quantities={"z": trajectory.qpos[:, 2]}))
    (contact,) = data["contacts"]
    first, rows = data["at"](contact["first"]), data["at"](contact["rows"]).reshape(-1, 6)
    assert contact["most"] == 1
    assert first[-1] - first[-2] == 1
    np.testing.assert_allclose(rows[-1, 3:], [0, 0, 2 * 9.81], rtol=1e-3, atol=1e-3)
    assert data["series"][0]["name"] == "z"
    np.testing.assert_allclose(data["at"](data["series"][0]["values"]), trajectory.qpos[:, 2])


def test_the_page_asks_nothing_of_a_network(rng):
    model = mujoco.MjModel.from_xml_string(SCENE)
    page = html(model, moved(model, rng, 3), title="a </script> & b")
    assert not re.search(r'(src|href)\s*=\s*["\']?(https?:)?//', page.text)
    assert not re.search(
        r"\b(fetch|XMLHttpRequest|importScripts|import)\s*\(\s*[\"'`]http", page.text
    )
    assert "a &lt;/script&gt; &amp; b" in page.text
    assert page._repr_html_().startswith("<iframe srcdoc=")


PENDULUM = """
<mujoco>
  <worldbody>
    <body pos="0 0 1">
      <joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -1"/>
    </body>
  </worldbody>
</mujoco>
"""


def test_the_camera_sees_all_of_a_swing(rng):
    """From the hanging pendulum alone its upper half would be out of the picture."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    states = moved(model, rng, 100)
    camera = record(html(model, states.replace(qpos=np.linspace(0, np.pi, 100)[:, None])))["camera"]
    np.testing.assert_allclose(camera["target"], [-0.25, 0, 1], atol=0.05)
    forward = np.deg2rad([camera["azimuth"], camera["elevation"]])
    seen = camera["distance"] * np.tan(np.deg2rad(45 / 2))  # half of the picture's height
    assert forward[0] == pytest.approx(np.pi / 2)
    assert seen * np.cos(forward[1]) > 1.0
    # Something that falls for ever is let go.
    fallen = record(html(mujoco.MjModel.from_xml_string(BALL), _falling()))["camera"]
    assert fallen["distance"] < 4


def _falling() -> jaxsim.State:
    states = moved(mujoco.MjModel.from_xml_string(BALL), np.random.default_rng(0), 10)
    qpos = np.tile([0, 0, 1, 1.0, 0, 0, 0], (10, 1))
    qpos[:, 2] -= 100 * np.arange(10)
    return states.replace(qpos=qpos)


def test_long_trajectories_are_thinned_out_evenly(monkeypatch, rng):
    model = mujoco.MjModel.from_xml_string(SCENE)
    monkeypatch.setattr("jaxsim.viz.page.MAX_NUMBERS", 3 * 7 * 50)
    data = record(html(model, moved(model, rng, 100)))
    np.testing.assert_allclose(data["at"](data["times"]), 0.02 * np.arange(50), rtol=1e-5)


def test_wrong_shapes_are_named(rng):
    model = mujoco.MjModel.from_xml_string(SCENE)
    states = moved(model, rng, 4)
    one = jax.tree.map(lambda x: x[0], states)
    with pytest.raises(ValueError, match=r"trajectory.qpos must have shape \(T, 8\)"):
        html(model, one)
    with pytest.raises(ValueError, match="ghost.qpos must have the shape"):
        html(model, states, ghost=jax.tree.map(lambda x: x[:2], states))
    with pytest.raises(ValueError, match=r"quantities\['x'\] must have shape \(4,\)"):
        html(model, states, quantities={"x": np.zeros(5)})


BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the page in")
def test_a_browser_shows_bodies_where_they_are(rng, tmp_path):
    """In a real browser without a network: no error, and each body of each frame in its place."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    states = moved(model, rng, 2, 3)
    page = html(model, states, ghost=states)
    probe = """<script>
      const found = [0, 1].map((env) => [0, 1, 2].map((t) => {
        jaxsim.seek(0.01 * t); return [0, 1, 2].map((slot) => jaxsim.position(env, slot)); }));
      document.title = JSON.stringify(found);
    </script></body>"""
    file = tmp_path / "page.html"
    file.write_text(page.text.replace("</body>", probe))
    flags = (
        "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run"
    )
    flags += " --disable-background-networking --disable-component-update --disable-sync --dump-dom"
    command = [BROWSER, *flags.split(), f"--user-data-dir={tmp_path / 'profile'}", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = np.array(json.loads(re.search("<title>(.*?)</title>", done.stdout)[1]))
    data = record(page)
    places = np.array(data["places"])
    for env in range(2):
        poses = data["at"](data["poses"][env]).reshape(3, 3, 7)
        np.testing.assert_allclose(found[env], poses[..., :3] + places[env], atol=1e-5)
