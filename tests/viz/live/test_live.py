"""Live views: time, forces by the mouse, and what a page shows."""

import os
import shutil
import subprocess
import sys
import threading

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim import envs
from jaxsim.viz.live import Free, Inputs, Parameters, Played, in_browser, in_window
from jaxsim.viz.live.browser import Browser, Wishes
from jaxsim.viz.live.clock import Clock
from jaxsim.viz.live.pull import Pull
from jaxsim.viz.live.show import _Show
from jaxsim.viz.live.solids import solid

BALL = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="ball" pos="0 0 1">
      <joint type="slide" axis="1 0 0" damping="1"/><joint type="slide" axis="0 0 1"/>
      <geom size=".1" mass="2" contype="0"/>
    </body>
  </worldbody>
</mujoco>
"""

# Opens the window, closes it after .3 s of simulated time, and says how much was simulated.
WINDOW = """
import threading, time
import mujoco.viewer
import jaxsim
from jaxsim.viz.live import Free, in_window

launch, seen = mujoco.viewer.launch_passive, []

def watched(model, data, **options):
    window = launch(model, data, **options)
    seen.append(data)
    def close():
        while data.time < 0.3:
            time.sleep(0.05)
        window.close()
    threading.Thread(target=close, daemon=True).start()
    return window

mujoco.viewer.launch_passive = watched
in_window(Free(jaxsim.load('''{xml}''')))
print(seen[0].time)
"""


def test_time_keeps_pace_and_what_is_missed_is_dropped():
    clock = Clock(dt=0.01, frame=0.1)
    assert [clock.due(0.025, 1.0) for _ in range(4)] == [2, 3, 2, 3]
    assert clock.due(100.0, 1.0) == 20  # two frames at most
    assert Clock(0.01, 0.1).due(0.1, 0.5) == 5
    assert clock.due(0.0, 1.0) == 0


def test_a_pulled_ball_comes_to_the_pointer():
    """Spring and damper hold it where gravity and spring balance: g / k below the pointer."""
    show = _Show(Free(jaxsim.load(BALL)))
    wishes = Wishes(Parameters.of(show.drawn), ctrl=np.zeros(0))
    target = np.array([0.3, 0.0, 1.5])
    for _ in range(300):
        wishes.pull = Pull(1, np.array(show.data.xpos[1]), target)
        show.advance(wishes, 0.02)
    np.testing.assert_allclose(show.data.xpos[1], target - [0, 0, 9.81 / 40], atol=2e-3)
    wishes.paused = True
    before = float(show.state.time)
    show.advance(wishes, 0.02)
    assert float(show.state.time) == before
    wishes.reset, wishes.pull = True, None
    show.advance(wishes, 0.02)
    np.testing.assert_allclose(show.data.xpos[1], [0, 0, 1], atol=1e-6)
    wishes.paused, wishes.parameters = False, wishes.parameters.replace(gravity=0.0)
    for _ in range(10):
        show.advance(wishes, 0.02)
    np.testing.assert_allclose(show.data.xpos[1], [0, 0, 1], atol=1e-6)
    assert show.contacts(wishes).shape == (0, 6)
    # Half the mass and three times the damping: v' = v / (1 + h d / m), with h = 0.01 s.
    wishes.parameters = wishes.parameters.replace(mass=(1.0, 0.5), damping=3.0)
    show._state = show.state.replace(qvel=jnp.array([1.0, 0.0]))
    show.advance(wishes, 0.02)
    np.testing.assert_allclose(show.state.qvel[0], (1 + 0.01 * 3 / 1) ** -2, rtol=1e-5)
    assert show._source._steps._cache_size() == 1  # not compiled again


def test_a_pull_off_the_middle_turns_the_body():
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    wrench = Pull(1, np.array([0, 0.1, 1.0]), np.array([0.5, 0.1, 1.0])).wrench(model, data)
    np.testing.assert_allclose(wrench[:3], [40 * 2 * 0.5, 0, 0], atol=1e-9)
    np.testing.assert_allclose(wrench[3:], np.cross([0, 0.1, 0], wrench[:3]), atol=1e-9)


def test_a_policy_plays_and_episodes_start_again():
    env = envs.make("fast", max_episode_steps=3)
    played = Played(env, lambda obs: jnp.ones(env.action_size))
    inputs = Inputs.of(played.model)
    state = played.advance(played.reset(0), inputs, 2)
    assert played.physics(state).time == pytest.approx(2 * float(env.dt))
    assert played.physics(played.advance(state, inputs, 1)).time == 0


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("box", [0.1, 0.2, 0.3], 8 * 0.006),
        ("sphere", [0.5, 0, 0], 4 / 3 * np.pi * 0.125),
        ("ellipsoid", [0.1, 0.2, 0.3], 4 / 3 * np.pi * 0.006),
        ("cylinder", [0.2, 0.5, 0], np.pi * 0.04),
        ("capsule", [0.2, 0.5, 0], np.pi * 0.04 + 4 / 3 * np.pi * 0.008),
    ],
)
def test_triangles_enclose_the_volume_of_the_shape(kind, size, volume):
    """By the divergence theorem; positive, so that faces look outwards."""
    shape = solid({"type": kind, "size": size}, None)
    a, b, c = np.moveaxis(shape.points[shape.faces], 1, 0)
    found = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    assert found == pytest.approx(volume, rel=0.03)


def test_a_page_is_served():
    pytest.importorskip("viser")
    import urllib.request

    seen, ended = [], threading.Event()

    def ready(url):
        with urllib.request.urlopen(url, timeout=30) as page:
            seen.append(page.read(200))
        ended.set()

    in_browser(Free(jaxsim.load(BALL)), port=8765, ready=ready, until=ended.is_set)
    assert b"html" in seen[0]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_a_window_without_a_display_is_refused(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RuntimeError, match="needs a display"):
        in_window(Free(jaxsim.load(BALL)))


def test_what_to_install_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(RuntimeError, match="pip install viser"):
        Browser(mujoco.MjModel.from_xml_string(BALL), True, "127.0.0.1", 8765, "")


def test_a_page_shows_bodies_and_marks():
    pytest.importorskip("viser")
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    page = Browser(model, True, "127.0.0.1", 8765, "")
    try:
        page.wishes.com = True
        page.show(data, np.ones((2, 6)), 0.1, "now")
        page.show(data, np.zeros((0, 6)), 0.1, "later")
        assert page._text.value == "later"
        np.testing.assert_allclose(page._bodies[1].position, [0, 0, 1])
    finally:
        page.close()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs a virtual display, Xvfb")
def test_a_window_opens_on_a_display(tmp_path):
    """MuJoCo's own window shows our steps; in a process of its own, whose display it is."""
    read, write = os.pipe()
    screen = ["Xvfb", "-displayfd", str(write), "-screen", "0", "800x600x24"]
    display = subprocess.Popen(screen, pass_fds=[write], stderr=subprocess.DEVNULL)
    try:
        number = os.read(read, 16).decode().strip()
        done = subprocess.run(
            [sys.executable, "-c", WINDOW.format(xml=BALL)],
            env={**os.environ, "DISPLAY": f":{number}", "MUJOCO_GL": "glfw"},
            capture_output=True,
            text=True,
            timeout=300,
        )
    finally:
        display.terminate()
        display.wait()
    assert done.returncode == 0, done.stderr[-2000:]
    assert float(done.stdout) > 0.3  # s, simulated while it was open
