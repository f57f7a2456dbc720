"""The pages about environments: as fresh as the code, true, and their examples run."""

import importlib.util
import pathlib
import re
import subprocess
import sys

import gymnasium
import jax
import pytest

import jaxsim.envs
from jaxsim.cli import main
from jaxsim.envs.bridges import spaces
from jaxsim.envs.bridges.documented import documented
from jaxsim.envs.registry import entries
from jaxsim.envs.registry.describe import describe

DOCS = pathlib.Path(__file__).parents[2] / "docs"
BUNDLED = [n for n in jaxsim.envs.names() if isinstance(jaxsim.envs.spec(n).cls, str)]


@pytest.fixture(scope="module")
def generator():
    spec = importlib.util.spec_from_file_location("generate_envs", DOCS / "generate_envs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pages_are_fresh(generator):
    """Otherwise run `python docs/generate_envs.py`."""
    expected = generator.pages()
    found = {path.name: path.read_text("utf-8") for path in (DOCS / "envs").glob("*.md")}
    assert set(found) == set(expected)
    for name, text in expected.items():
        assert found[name] == text, f"{name} is stale"


@pytest.mark.parametrize("name", BUNDLED)
def test_documented_sizes_are_the_sizes(name):
    cls = jaxsim.envs.spec(name).load()
    env = cls()
    shape = jax.eval_shape(env.reset, jax.random.key(0)).obs.shape
    assert describe(cls).sizes == {"observation": shape[0], "action": env.action_size}
    known = documented(name, {})
    if name == "quadruped":  # its actions are not the controls of its motors
        assert known is None
        return
    assert known.observation_space == spaces.observation_space(env)
    assert known.action_space == spaces.action_space(env)
    assert known.dt == pytest.approx(float(env.dt))


@pytest.mark.parametrize("name", BUNDLED)
def test_everything_is_told(name):
    page = describe(jaxsim.envs.spec(name).load())
    assert page.summary.endswith(".")
    assert {"Observation", "Action", "Reward", "Episode"} <= set(page.sections)
    differences = " ".join(page.sections.get(x, "") for x in ("Gymnasium", "Differences from"))
    brax = page.sections.get("Brax", "") + page.sections.get("Differences from", "")
    assert differences.strip()
    assert brax.strip()
    assert [o.name for o in page.options if not o.meaning] == []


@pytest.mark.slow
def test_the_robot_of_ones_own_steps(tmp_path):
    """The file of the page, inspected, completed and simulated as the page says."""
    text = (DOCS / "your_robot.md").read_text("utf-8")
    (tmp_path / "arm.urdf").write_text(re.search(r"```xml\n(.*?)```", text, re.DOTALL)[1])
    assert main(["inspect", str(tmp_path / "arm.urdf")]) == 0
    command = [sys.executable, "-c", "\n".join(blocks("your_robot"))]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]


def blocks(page: str) -> list[str]:
    """The runnable examples of a page."""
    text = (DOCS / f"{page}.md").read_text("utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", ["own_environment", "bridges", "quick_start", "coming_from", "how_to", "pictures"]
)
def test_examples_of_a_page_run(page, tmp_path):
    """All blocks in order, in a process and a folder of their own."""
    command = [sys.executable, "-c", "\n".join(blocks(page))]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_environment_of_ones_own_is_one(monkeypatch):
    """Its class, about 40 lines, in this process; traced and not compiled, which is fast."""
    monkeypatch.setattr(entries, "_SPECS", dict(entries._SPECS))
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    block = blocks("own_environment")[0]
    assert len(block[block.index("@struct.dataclass") :].splitlines()) <= 40
    exec(block, {"__name__": "hover"})
    env = jaxsim.envs.make("hover")
    state = jax.eval_shape(env.reset, jax.random.key(0))
    after = jax.eval_shape(env.step, state, jax.ShapeDtypeStruct((2,), "float32"))
    assert after.obs.shape == (env.observation_size,) == (6,)
    assert jax.tree.structure(after) == jax.tree.structure(state)
    assert set(after.metrics) == {"near", "effort"}
