"""What a training tells: JSON lines, TensorBoard, a progress bar."""

import json
import math
import pathlib
import time
from typing import Any

import rich.console
import rich.progress

Row = dict[str, float]


class Logs:
    """Writes rows of numbers to "metrics.jsonl" and, where tensorboardX is installed, for it.

    Attributes:
      path: the file of JSON lines.
    """

    def __init__(self, directory: pathlib.Path):
        directory.mkdir(parents=True, exist_ok=True)
        self.path = directory / "metrics.jsonl"
        self._file = self.path.open("a", encoding="utf-8")
        self._board = _tensorboard(directory / "tensorboard")

    def write(self, row: Row) -> None:
        """Append a row; numbers that are not finite are written as null."""
        plain = {k: v if math.isfinite(v) else None for k, v in row.items()}
        self._file.write(json.dumps(plain) + "\n")
        self._file.flush()
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
    """The rows of a file of JSON lines; null becomes NaN."""
    lines = pathlib.Path(path).read_text("utf-8").splitlines()
    rows = [json.loads(line) for line in lines]
    return [{k: math.nan if v is None else v for k, v in row.items()} for row in rows]


class Bar:
    """A progress bar on standard error: reward, steps per second, time left."""

    def __init__(self, title: str, total_steps: int, done: int = 0):
        field = rich.progress.TextColumn
        self._progress = rich.progress.Progress(
            field("{task.description}"),
            rich.progress.BarColumn(bar_width=None),
            rich.progress.TaskProgressColumn(),
            field("reward {task.fields[reward]}"),
            field("evaluated {task.fields[evaluated]}"),
            field("{task.fields[speed]} steps/s"),
            field("left"),
            rich.progress.TimeRemainingColumn(),
            console=rich.console.Console(stderr=True),
        )
        self._task = self._progress.add_task(
            title, total=total_steps, completed=done, reward="-", evaluated="-", speed="-"
        )
        self._rate = Rate()
        self._progress.start()

    def write(self, row: Row) -> None:
        """Show the newest row."""
        fields: dict[str, Any] = {"speed": f"{self._rate.update(row['steps']):,.0f}"}
        if math.isfinite(row.get("episode_return", math.nan)):
            fields["reward"] = f"{row['episode_return']:,.1f}"
        if "eval_return" in row:
            fields["evaluated"] = f"{row['eval_return']:,.1f}"
        if row.get("nonfinite", 0) > 0:
            self._progress.console.print(
                f"{row['nonfinite']:.0f} environments diverged and were reset", style="yellow"
            )
        self._progress.update(self._task, completed=row["steps"], **fields)

    def close(self) -> None:
        """Leave the last line on the screen."""
        self._progress.stop()


class Rate:
    """Steps per second between updates, smoothed over a few of them."""

    def __init__(self):
        self._time, self._steps, self._rate = time.perf_counter(), None, 0.0

    def update(self, steps: float) -> float:
        """Rate after `steps` steps in total."""
        now = time.perf_counter()
        if self._steps is not None and now > self._time:
            rate = (steps - self._steps) / (now - self._time)
            self._rate = rate if self._rate == 0 else 0.8 * self._rate + 0.2 * rate
        self._time, self._steps = now, steps
        return self._rate


def _tensorboard(directory: pathlib.Path):
    try:
        import tensorboardX
    except ImportError:
        return None
    return tensorboardX.SummaryWriter(str(directory))
