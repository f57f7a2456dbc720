"""The plot of a fit shows its numbers."""

from types import SimpleNamespace

import numpy as np

from jaxsim import viz


def test_measured_predicted_and_residual(rng):
    measured, predicted = rng.normal(size=(2, 3, 5, 4))
    weight = np.ones((3, 5))
    weight[2, :3] = 0  # the last window overlaps
    windows = SimpleNamespace(qpos=measured, weight=weight)
    fit = SimpleNamespace(windows=windows, predicted_qpos=predicted)
    measured, predicted = (np.where(weight[..., None], x, np.nan) for x in (measured, predicted))
    picture = viz.plot_fit(fit, coordinates=[2])
    above, below = (axes.lines for axes in picture.axes)
    np.testing.assert_array_equal(above[0].get_ydata(), measured[..., 2].ravel())
    for window in range(3):
        np.testing.assert_array_equal(above[1 + window].get_ydata(), predicted[window, :, 2])
        error = (measured - predicted)[window, :, 2]
        np.testing.assert_array_equal(below[window].get_ydata(), error)
    assert above[0].get_xdata()[-1] == 11
    assert picture._repr_png_()[1:4] == b"PNG"
