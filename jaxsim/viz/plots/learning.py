"""Learning curves as pictures."""

import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from jaxsim.viz.picture import Picture


def plot_learning(
    runs: Mapping[str, Sequence[Mapping[str, float]]],
    path: str | pathlib.Path | None = None,
    title: str = "",
    goal: float | None = None,
) -> Picture:
    """Draw returns against wall time and against environment steps.

        result = jaxsim.rl.train("inverted_pendulum")
        jaxsim.viz.plot_learning({"ppo": result.history})

    Args:
      runs: rows of each run, by the name of its curve; those with "eval_return" are drawn as a
        line with points, "episode_return" of training as a thin line behind it.
      path: file to write; its ending is the format.
      title: above the picture.
      goal: return to mark by a horizontal line.

    Returns:
      The picture.

    Raises:
      RuntimeError: matplotlib is not installed.
    """
    picture = Picture(columns=2, title=title, sharey=True)
    for axes, column, label in zip(
        picture.axes, ("seconds", "steps"), ("wall time (s)", "steps"), strict=True
    ):
        for index, (name, rows) in enumerate(runs.items()):
            _draw(axes, rows, column, name, f"C{index}", "while training" if index == 0 else None)
        if goal is not None:
            axes.axhline(goal, color="gray", linestyle=":")
        axes.set_xlabel(label)
    picture.axes[0].set_ylabel("return of an episode")
    picture.axes[1].xaxis.set_major_formatter("{x:,.0f}")
    picture.axes[1].locator_params(axis="x", nbins=5)
    picture.axes[1].legend()
    if path is not None:
        picture.save(path)
    return picture


def _draw(
    axes: Any,
    rows: Sequence[Mapping[str, float]],
    column: str,
    name: str,
    color: str,
    pale: str | None,
):
    """One run; `pale` is the label of the thin line."""
    training = [(row[column], row.get("episode_return", float("nan"))) for row in rows]
    axes.plot(*zip(*training, strict=True), color=color, alpha=0.3, linewidth=1, label=pale)
    evaluated = [(row[column], row["eval_return"]) for row in rows if "eval_return" in row]
    if evaluated:
        axes.plot(*zip(*evaluated, strict=True), "o-", color=color, label=name, markersize=3)
