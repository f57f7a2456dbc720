"""A progress bar for a training."""

import math
import time
from collections.abc import Mapping
from typing import Any

import rich.console
import rich.progress

from jaxsim.rl.metrics import Row


class Bar:
    """A progress bar on standard error, with reward, steps per second and remaining time."""

    def __init__(self, title: str):
        """Show the title."""
        field = rich.progress.TextColumn
        self._title = title
        self._progress = rich.progress.Progress(
            field("{task.description}"),
            rich.progress.BarColumn(bar_width=None),
            rich.progress.TaskProgressColumn(),
            field("{task.fields[numbers]}"),
            rich.progress.TimeElapsedColumn(),
            field("left"),
            rich.progress.TimeRemainingColumn(),
            console=rich.console.Console(stderr=True),
        )
        self._task = self._progress.add_task(title, total=None, numbers="")
        self._rate = Rate()
        self._numbers = {"reward": "-", "evaluated": "-"}
        self._progress.start()

    def compiling(self) -> None:
        """Show that programs are being compiled."""
        self._progress.update(self._task, description=f"{self._title}: compiling")

    def training(self, total_steps: int, done: int) -> None:
        """Show the progress of the training."""
        self._progress.reset(self._task, description=self._title, total=total_steps, completed=done)
        self._show(done, "-")

    def pace(self, rates: Mapping[str, float]) -> None:
        """Say steps per second of the parts of an epoch, in a line of its own."""
        parts = ", ".join(f"{name} {rate:,.0f}" for name, rate in rates.items())
        self._progress.console.print(f"steps/s of an epoch's parts: {parts}")

    def write(self, row: Row) -> None:
        """Show the newest row."""
        if math.isfinite(row.get("episode_return", math.nan)):
            self._numbers["reward"] = f"{row['episode_return']:,.1f}"
        if "eval_return" in row:
            self._numbers["evaluated"] = f"{row['eval_return']:,.1f}"
        if row.get("nonfinite", 0) > 0:
            self._progress.console.print(
                f"{row['nonfinite']:.0f} environments diverged and were reset", style="yellow"
            )
        self._show(row["steps"], f"{self._rate.update(row['steps']):,.0f}")

    def finish(self) -> None:
        """Fill the bar, even if the target was reached early."""
        self._progress.update(self._task, total=self._progress.tasks[0].completed)

    def close(self) -> None:
        """Leave the last line on the screen."""
        self._progress.stop()

    def _show(self, steps: float, speed: str) -> None:
        words = (f"{name} {number}" for name, number in self._numbers.items())
        numbers: Any = "  ".join((*words, f"{speed} steps/s"))
        self._progress.update(self._task, completed=steps, numbers=numbers)


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
