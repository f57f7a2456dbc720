"""Functions take and return the shapes that they are annotated with."""

import os
import pathlib
import subprocess
import sys

TESTS = pathlib.Path(__file__).parent


def test_annotations_hold():
    """In a process of its own: annotations are checked from the import of jaxsim on."""
    done = subprocess.run(
        [sys.executable, TESTS / "shapes.py"],
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "PYTHONPATH": str(TESTS.parent)},
    )
    assert done.returncode == 0, done.stderr[-3000:]
