"""Figures in one style, without a display."""

import io
import pathlib
from typing import Any

import numpy as np

_NO_MATPLOTLIB = "drawing a plot needs matplotlib: pip install matplotlib"
_STYLE: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
}
MOST_LINES = 12  # of one panel; more of them nobody can tell apart


class Picture:
    """A figure of matplotlib's; a notebook shows it where it is the value of a cell.

    Attributes:
      figure: the figure, to change or to add to.
      axes: its panels.
    """

    def __init__(self, columns: int = 1, rows: int = 1, title: str = "", **options: Any):
        """An empty figure.

        Args:
          columns: panels side by side.
          rows: panels on top of each other.
          title: above all of them.
          **options: of `Figure.subplots`.

        Raises:
          RuntimeError: matplotlib is not installed.
        """
        try:
            import matplotlib
            from matplotlib.figure import Figure
        except ImportError as error:
            raise RuntimeError(_NO_MATPLOTLIB) from error
        with matplotlib.rc_context(_STYLE):
            self.figure = Figure(figsize=(4.5 * max(columns, 1.5), 1 + 2.5 * rows))
            self.figure.set_layout_engine("constrained")
            self.axes = self.figure.subplots(rows, columns, squeeze=False, **options).ravel()
        self.figure.suptitle(title)

    def save(self, path: str | pathlib.Path) -> pathlib.Path:
        """Write the picture; the ending is the format. Returns the path."""
        self.figure.savefig(path)
        return pathlib.Path(path)

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.figure.savefig(data, format="png", dpi=100)
        return data.getvalue()


def draw_lines(axes: Any, time: Any, values: Any) -> None:
    """Draw numbers (T,) or (T, k) against time; of many the first twelve."""
    shown = np.asarray(values).reshape(len(time), -1)[:, :MOST_LINES]
    axes.plot(time, shown, label=[str(i) for i in range(shown.shape[1])])
    if shown.shape[1] > 1:
        axes.legend(ncols=6, fontsize="small")
