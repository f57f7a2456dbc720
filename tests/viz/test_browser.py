"""The page of `jaxsim.viz.html` in a real browser: small, smooth, and like MuJoCo's pictures."""

import base64
import contextlib
import http.server
import io
import json
import shutil
import subprocess
import threading

import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.viz import html
from jaxsim.viz.canvas import Canvas

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = (
    "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--window-size=640,480"
)
STEPS, DT = 1000, 0.005

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the page in"),
]


@contextlib.contextmanager
def mailbox():
    """An address of this machine, and a list of what is sent to it."""
    letters, arrived = [], threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            letters.append(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(204)
            self.end_headers()
            arrived.set()

        def log_message(self, *_):
            pass

    server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", letters, arrived
    finally:
        server.shutdown()
        server.server_close()


def told_by_browser(page, probe: str, folder) -> dict:
    """What the body of a JavaScript function returns after the page has loaded."""
    with mailbox() as (address, letters, arrived):
        script = f"""<script>
          const trouble = [];
          window.onerror = (message) => {{ trouble.push(message); }};
          const send = (value) => fetch("{address}", {{ method: "POST", mode: "no-cors",
            body: JSON.stringify({{ trouble, value }}) }});
          const later = (ms) => new Promise((done) => setTimeout(done, ms));
          const probe = async () => {{ {probe} }};
          probe().then(send, (error) => {{ trouble.push(String(error)); send(null); }});
        </script></body>"""
        file = folder / "page.html"
        file.write_text(page.text.replace("</body>", script))
        profile = f"--user-data-dir={folder / 'profile'}"
        browser = subprocess.Popen(
            [BROWSER, *FLAGS.split(), profile, file.as_uri()],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            assert arrived.wait(120), "the browser said nothing"
        finally:
            browser.kill()
            browser.wait()
    told = json.loads(letters[0])
    assert told["trouble"] == []
    return told["value"]


@pytest.fixture
def humanoid(bundled):
    """A humanoid that falls and struggles, by MuJoCo; its model without the floor, and states."""
    model = bundled("humanoid")
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    model.opt.timestep = DT
    one, rows = jaxsim.make_state(jaxsim.load(model)), []
    for step in range(STEPS):
        if step % 20 == 0:
            data.ctrl[:] = rng.uniform(-0.4, 0.4, model.nu)
        mujoco.mj_step(model, data)
        rows.append((data.qpos.copy(), data.qvel.copy(), data.time))
    qpos, qvel, time = (np.stack(x) for x in zip(*rows, strict=True))
    rest = "act qacc_warmstart qfrc_applied xfrc_applied mocap_pos mocap_quat".split()
    zeros = {name: np.zeros((STEPS, *np.shape(getattr(one, name)))) for name in rest}
    states = one.replace(qpos=qpos, qvel=qvel, time=time, time_excess=None, **zeros)
    model.geom_group[model.geom_bodyid == 0] = 5  # not drawn, here and by MuJoCo
    return model, states


def test_a_long_simulation_is_small_and_smooth(humanoid, tmp_path):
    """1,000 steps of a humanoid: below 3 MB, and 20 frames a second without a graphics card."""
    page = html(*humanoid)
    assert len(page.text) < 3e6
    probe = """
      const stamps = [];
      const note = (stamp) => { stamps.push(stamp); requestAnimationFrame(note); };
      await later(2500);
      requestAnimationFrame(note);
      await later(3000);
      return stamps.map((stamp, i) => stamp - stamps[i - 1]).slice(1);
    """
    frames = np.array(told_by_browser(page, probe, tmp_path))
    late = np.percentile(frames, 90)
    assert np.median(frames) < 1000 / 20, f"median {np.median(frames):.1f} ms, 90% {late:.1f} ms"


@pytest.mark.parametrize("step", [60, 300])  # standing and lying
def test_pictures_have_the_outlines_of_mujoco(humanoid, tmp_path, step):
    """From the same place, the pixels that show bodies are the same but for edges."""
    model, states = humanoid
    probe = f"""
      jaxsim.seek({DT * step});
      const {{ position }} = jaxsim.camera, {{ target }} = jaxsim.controls;
      position.lerp(target, 0.4);  // nearer
      jaxsim.controls.update();
      jaxsim.seek({DT * step});
      return {{ picture: document.getElementById("view").toDataURL(),
               position: position.toArray(), target: target.toArray() }};
    """
    told = told_by_browser(html(model, states), probe, tmp_path)
    imageio = pytest.importorskip("imageio.v3")
    picture = imageio.imread(io.BytesIO(base64.b64decode(told["picture"].split(",")[1])))[..., :3]
    shown = np.abs(picture.astype(int) - picture[0, 0]).max(-1) > 12
    expected = outline(model, states.qpos[step], np.array(told["position"]), told["target"], shown)
    assert expected.mean() > 0.01
    overlap = (shown & expected).sum() / (shown | expected).sum()
    assert overlap > 0.95


def outline(model, qpos, position, target, like) -> np.ndarray:
    """Pixels in which MuJoCo shows something, with a picture's shape and a camera at a position."""
    height, width = like.shape
    along = np.array(target) - position
    camera, data = mujoco.MjvCamera(), mujoco.MjData(model)
    camera.lookat[:], camera.distance = target, np.linalg.norm(along)
    camera.azimuth = np.degrees(np.arctan2(along[1], along[0]))
    camera.elevation = np.degrees(np.arcsin(along[2] / camera.distance))
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    scene, seen = mujoco.MjvScene(model, 1000), int(mujoco.mjtCatBit.mjCAT_ALL)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, seen, scene)
    scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = True
    try:
        canvas = Canvas(model, width, height)
    except RuntimeError as error:
        pytest.skip(str(error))
    try:
        return canvas.draw(scene, "").max(-1) > 0
    finally:
        canvas.close()
