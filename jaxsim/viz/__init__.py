"""Pictures of simulations, by MuJoCo's renderer."""

from jaxsim.viz.frames import Frames
from jaxsim.viz.page import Page, html
from jaxsim.viz.scene import scene

__all__ = ["Frames", "Page", "html", "scene"]
