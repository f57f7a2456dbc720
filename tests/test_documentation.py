"""The documentation: generated pages are fresh, pages are in the navigation, and it builds."""

import importlib.util
import os
import pathlib
import re
import shutil
import subprocess

import mujoco
import pytest

ROOT = pathlib.Path(__file__).parents[1]
DOCS = ROOT / "docs"


def test_table_of_features_is_fresh():
    """Otherwise run `python docs/generate_features.py`."""
    pytest.importorskip("mujoco.mjx")
    stored = (DOCS / "features.md").read_text("utf-8")
    if f"MuJoCo {mujoco.__version__}'s" not in stored:
        pytest.skip("written for another version of MuJoCo")
    spec = importlib.util.spec_from_file_location("features", DOCS / "generate_features.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert stored == module.page()


def test_every_page_is_in_the_navigation():
    listed = set(re.findall(r"\w+\.md", (ROOT / "mkdocs.yml").read_text("utf-8")))
    assert {path.name for path in DOCS.glob("*.md")} - {"api.md"} <= listed


def test_links_between_pages_lead_somewhere():
    for path in [*DOCS.rglob("*.md"), ROOT / "README.md"]:
        text = re.sub(r"^```.*?^```", "", path.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
        for link in re.findall(r"\]\((?!https?:)([^)#\s]+)[^)]*\)", text):
            made = link.startswith("reference/")  # by mkdocstrings
            assert made or (path.parent / link).exists(), f"{path.name}: {link}"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("mkdocs") is None, reason="needs the extra docs")
def test_it_builds_without_warnings(tmp_path):
    done = subprocess.run(
        ["mkdocs", "build", "--strict", "-q", "-d", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "def step" in re.sub("<[^>]*>", "", (tmp_path / "reference/jaxsim.html").read_text())
