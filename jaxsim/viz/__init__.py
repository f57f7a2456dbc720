"""Pictures of simulations, by MuJoCo's renderer."""

from jaxsim.viz.frames import Frames
from jaxsim.viz.page import Page, html

__all__ = ["Frames", "Page", "html"]
