"""The notebook runs from top to bottom, and is stored without outputs."""

import pathlib
import time

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((pathlib.Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request) -> nbformat.NotebookNode:
    """Each notebook in turn."""
    return nbformat.read(request.param, as_version=4)


def test_there_are_notebooks():
    assert NOTEBOOKS


def test_stored_without_outputs(notebook):
    """Outputs make differences unreadable, and age."""
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code)
    for number, cell in enumerate(code):
        compile(cell.source, f"cell {number}", "exec")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # those of the notebook's server
def test_runs_within_three_minutes(notebook):
    start = time.perf_counter()
    NotebookClient(notebook, timeout=180, kernel_name="python3").execute()
    assert time.perf_counter() - start < 180
    pictures = [o for cell in notebook.cells for o in cell.get("outputs", []) if "data" in o]
    assert any("image/png" in o.data for o in pictures)
    assert any("text/html" in o.data for o in pictures)
