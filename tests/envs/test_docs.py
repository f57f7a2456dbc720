"""The pages about environments: as fresh as the code, true, and their examples run."""

import importlib.util
import pathlib
import re
import subprocess
import sys

import jax
import pytest

import jaxsim.envs
from jaxsim.envs.describe import describe

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


@pytest.mark.parametrize("name", ["own_environment", "bridges"])
def test_examples_of_a_page_run(name):
    """All blocks of a page in order, in a process of their own."""
    text = (DOCS / f"{name}.md").read_text("utf-8")
    code = "\n".join(re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]


def test_an_environment_of_ones_own_takes_about_40_lines():
    text = (DOCS / "own_environment.md").read_text("utf-8")
    block = re.search(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[1]
    task = block[block.index("@struct.dataclass") :]
    assert len(task.splitlines()) <= 40
