"""What is built from a checkout holds everything that the package reads while it runs."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

import jaxsim.io
from jaxsim.rl import config

ROOT = pathlib.Path(__file__).parents[1]
TUNED = sorted((ROOT / "configs").glob("*/*.yaml"))
# Run from the wheel itself, which is a zip file: nothing may need a real folder.
PROBE = """
import json, jax, jaxsim, jaxsim.io
from jaxsim.rl import config
from jaxsim.viz import html
assert ".whl" in jaxsim.__file__, jaxsim.__file__
model = jaxsim.load("pendulum")
states = jax.tree.map(lambda x: x[None], jaxsim.make_state(model))
print(json.dumps({
    "models": jaxsim.io.bundled_models(),
    "settings": {f: config.read(config.find(*f.split("/"))) for f in %r},
    "page": len(html(model, states).text),
}))
"""


@pytest.mark.slow
def test_a_wheel_made_from_the_source_distribution_is_complete(tmp_path):
    _run("-m", "build", "--outdir", tmp_path, ROOT)  # the wheel is built from the sdist
    (wheel,) = tmp_path.glob("*.whl")
    names = [f"{path.parent.name}/{path.stem}" for path in TUNED]
    found = json.loads(_run("-c", PROBE % names, cwd=tmp_path, env={"PYTHONPATH": str(wheel)}))
    assert tuple(found["models"]) == jaxsim.io.bundled_models()
    for name, path in zip(names, TUNED, strict=True):
        assert found["settings"][name] == config.read(path)
    assert found["page"] > 100_000


def _run(*arguments, env=(), **options) -> str:
    command = [sys.executable, *map(str, arguments)]
    env = {**os.environ, **dict(env)}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, env=env, check=False, **options
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout
