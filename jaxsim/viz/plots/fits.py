"""How well a fitted model explains recordings."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxsim.viz.picture import MOST_LINES, Picture


def plot_fit(fit: Any, coordinates: Sequence[int] | None = None, title: str = "") -> Picture:
    """Draw what was measured and what a fit predicts, and the residual below.

    Windows stand one after the other; a prediction begins anew in each. Where windows overlap, the
    samples of the earlier one are shown.

    Args:
      fit: result of `jaxsim.sysid.fit`.
      coordinates: which numbers of `qpos`, the first twelve if it is None.
      title: above the picture.
    """
    measured, predicted = np.asarray(fit.windows.qpos), np.asarray(fit.predicted_qpos)
    counts, size = np.asarray(fit.windows.weight) > 0, measured.shape[2]
    samples = np.cumsum(counts).reshape(counts.shape) - 1
    measured = np.where(counts[..., None], measured, np.nan)
    predicted = np.where(counts[..., None], predicted, np.nan)
    picture = Picture(rows=2, title=title, sharex=True)
    above, below = picture.axes
    for color, i in enumerate(range(min(size, MOST_LINES)) if coordinates is None else coordinates):
        style = {"color": f"C{color}"}
        above.plot(samples.ravel(), measured[..., i].ravel(), ".", markersize=3, **style)
        above.plot(samples.T, predicted[..., i].T, linewidth=1, **style)
        below.plot(samples.T, (measured - predicted)[..., i].T, linewidth=1, **style)
    above.set_ylabel("qpos: measured (dots), predicted")
    below.set_ylabel("residual")
    below.set_xlabel("sample, window by window")
    return picture
