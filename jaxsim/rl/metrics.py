"""Logs of a training: rows of numbers as JSON lines and for TensorBoard."""

import json
import math
import os
import pathlib
from typing import Any

Row = dict[str, float]
ROWS = "metrics.jsonl"


class Logs:
    """Logs that write rows of numbers to "metrics.jsonl" and, if installed, by tensorboardX.

    Attributes:
      path: the file of JSON lines.
    """

    def __init__(self, directory: pathlib.Path, steps: int = 0):
        """Open the logs in a directory.

        Args:
          directory: existing directory of the run.
          steps: steps at which training continues; later rows are removed, as they will be
            repeated.
        """
        self.path = directory / ROWS
        if self.path.exists():
            rows = [row for row in read(self.path) if row["steps"] <= steps]
            replace(self.path, "".join(map(_line, rows)))
        self._file = self.path.open("ab", buffering=0)
        self._board = _tensorboard(directory / "tensorboard", steps)

    def write(self, row: Row) -> None:
        """Append a row; numbers that are not finite are written as null."""
        self._file.write(_line(row).encode("utf-8"))
        if self._board is not None:
            for name, value in row.items():
                if math.isfinite(value) and name != "steps":
                    self._board.add_scalar(name, value, int(row["steps"]))

    def close(self) -> None:
        """Close the files."""
        self._file.close()
        if self._board is not None:
            self._board.close()


def read(path: str | pathlib.Path) -> list[Row]:
    """The rows of a file of JSON lines; null becomes NaN.

    A line that a crash has truncated is left out. Work that was repeated after a crash replaces the
    earlier rows: a row replaces all previous ones with as many steps or more.
    """
    rows: list[Row] = []
    for line in pathlib.Path(path).read_text("utf-8", errors="replace").split("\n"):
        row = _parsed(line)
        if row is not None:
            while rows and rows[-1]["steps"] >= row["steps"]:
                rows.pop()
            rows.append(row)
    return rows


def replace(path: pathlib.Path, text: str) -> None:
    """Write a file so that a crash leaves either the old or the new one."""
    new = path.with_name(path.name + ".new")
    new.write_text(text, "utf-8")
    os.replace(new, path)


def _line(row: Row) -> str:
    return json.dumps({k: v if math.isfinite(v) else None for k, v in row.items()}) + "\n"


def _parsed(line: str) -> Row | None:
    """The row in a line, or None if the line is invalid."""
    try:
        values = json.loads(line)
        row = {name: math.nan if x is None else float(x) for name, x in values.items()}
        return {**row, "steps": int(row["steps"]), "seconds": row["seconds"]}
    except (ValueError, TypeError, AttributeError, KeyError):
        return None


def _tensorboard(directory: pathlib.Path, steps: int) -> Any:
    try:
        import tensorboardX
    except ImportError:
        return None
    return tensorboardX.SummaryWriter(str(directory), purge_step=steps + 1 if steps else None)
