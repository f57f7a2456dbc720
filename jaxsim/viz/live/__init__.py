"""A simulation that runs while one looks at it, in a browser or in MuJoCo's window."""

from jaxsim.viz.live.show import in_browser, in_window
from jaxsim.viz.live.source import Free, Inputs, Parameters, Played

__all__ = ["Free", "Inputs", "Parameters", "Played", "in_browser", "in_window"]
