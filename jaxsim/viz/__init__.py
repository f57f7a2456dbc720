"""Pictures of simulations: films by MuJoCo's renderer, and pages for a browser."""

from jaxsim.viz.filming import film
from jaxsim.viz.frames import Frames
from jaxsim.viz.page import Page, html
from jaxsim.viz.recording import load_trajectory, save_trajectory

__all__ = ["Frames", "Page", "film", "html", "load_trajectory", "save_trajectory"]
