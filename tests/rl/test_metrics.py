"""Rows of numbers: what a crash leaves in the file, and what a resume makes of it."""

import math

import pytest

from jaxsim.rl.metrics import Logs, read


def row(steps: int, **numbers: float) -> dict[str, float]:
    return {"steps": steps, "seconds": float(steps), **numbers}


@pytest.fixture
def logs(tmp_path):
    """Function from a number of steps to the logs of a run that goes on there."""
    return lambda steps: Logs(tmp_path, steps)


def test_rows_come_back(logs):
    first = logs(0)
    first.write(row(1, reward=math.inf))
    first.close()
    (found,) = read(first.path)
    assert (found["steps"], found["seconds"]) == (1, 1.0)
    assert math.isnan(found["reward"])


def test_what_is_done_again_replaces_what_was_done(tmp_path):
    """A crash after step 3, and a resume from the checkpoint of step 1, by an older version."""
    path = tmp_path / "metrics.jsonl"
    lines = [(1, 1), (2, 2), (3, 3), (2, 1.5), (3, 2.5)]
    path.write_text("".join(f'{{"steps": {n}, "seconds": {t}}}\n' for n, t in lines))
    assert [(r["steps"], r["seconds"]) for r in read(path)] == [(1, 1), (2, 1.5), (3, 2.5)]


def test_a_resume_drops_rows_of_work_that_was_lost(logs):
    first = logs(0)
    for steps in (1, 2, 3):
        first.write(row(steps))
    first.close()
    again = logs(1)
    again.write(row(2))
    again.close()
    assert len(again.path.read_text().splitlines()) == 2
    assert [r["steps"] for r in read(again.path)] == [1, 2]


@pytest.mark.parametrize(
    "cut",
    [
        '{"steps": 2, "sec{"steps": 2, "seconds": 2}',
        '{"steps": 2}',
        '{"steps": "a", "seconds": 1}',
        '{"steps": null, "seconds": 1}',
        "[1]",
        "\0\0\0",
        "",
    ],
)
def test_damaged_lines_are_left_out(tmp_path, cut):
    path = tmp_path / "metrics.jsonl"
    path.write_text('{"steps": 1, "seconds": 1}\n' + cut + '\n{"steps": 3, "seconds": 3}\n')
    assert [r["steps"] for r in read(path)] == [1, 3]


def test_a_cut_line_is_gone_after_a_resume(logs):
    first = logs(0)
    first.write(row(1))
    first.close()
    with first.path.open("a") as file:
        file.write('{"steps": 2, "sec')
    again = logs(1)
    again.write(row(2))
    again.close()
    assert [r["steps"] for r in read(again.path)] == [1, 2]
