"""Every public name has an example in `docs/examples`, and the examples run."""

import importlib.util
import pathlib
import re
import subprocess
import sys

import gymnasium
import pytest

from jaxsim.envs.registry import entries

DOCS = pathlib.Path(__file__).parents[1] / "docs"
PAGES = sorted((DOCS / "examples").glob("*.md"))


def code(page: pathlib.Path, *marks: str) -> str:
    """All blocks of a page in order; blocks with a mark only if it is among `marks`."""
    pattern = re.compile(
        r"^```(?:python|\{ \.python \.(\S+) \})\n(.*?)^```", re.DOTALL | re.MULTILINE
    )
    blocks = pattern.findall(page.read_text("utf-8"))
    return "\n".join(text for mark, text in blocks if not mark or mark in marks)


@pytest.fixture
def index():
    """The module that knows the public names."""
    spec = importlib.util.spec_from_file_location("generate_api", DOCS / "generate_api.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_public_name_has_an_example(index):
    words = {page.stem: set(re.findall(r"\w+", code(page, "slow"))) for page in PAGES}
    assert set(words) == set(index.PACKAGES)
    without = {package: set(new) - words[package] for package, new in index.new_names().items()}
    assert not any(without.values()), without


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(entries, "_SPECS", dict(entries._SPECS))
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    exec(code(page), {"__name__": page.stem})


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [p for p in PAGES if code(p) != code(p, "slow")], ids=lambda page: page.stem
)
def test_slow_examples_run(page, tmp_path):
    """With the others of their page, in a process of their own."""
    command = [sys.executable, "-c", code(page, "slow")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
