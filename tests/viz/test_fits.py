"""The plot of a fit shows its numbers."""

from types import SimpleNamespace

import numpy as np

from jaxsim import viz


def test_measured_predicted_and_residual(rng):
    measured, predicted = rng.normal(size=(2, 3, 5, 4))
    fit = SimpleNamespace(windows=SimpleNamespace(qpos=measured), predicted_qpos=predicted)
    picture = viz.plot_fit(fit, coordinates=[2])
    above, below = (axes.lines for axes in picture.axes)
    np.testing.assert_array_equal(above[0].get_ydata(), measured[..., 2].ravel())
    for window in range(3):
        np.testing.assert_array_equal(above[1 + window].get_ydata(), predicted[window, :, 2])
        error = (measured - predicted)[window, :, 2]
        np.testing.assert_array_equal(below[window].get_ydata(), error)
    assert picture._repr_png_()[1:4] == b"PNG"
