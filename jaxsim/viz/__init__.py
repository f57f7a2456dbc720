"""Pictures of simulations: films by MuJoCo's renderer, pages for a browser, plots."""

from jaxsim.viz.filming import film
from jaxsim.viz.frames import Frames
from jaxsim.viz.page import Page, html
from jaxsim.viz.picture import Picture
from jaxsim.viz.plots.fits import plot_fit
from jaxsim.viz.plots.learning import plot_learning
from jaxsim.viz.plots.plans import film_plan, plot_plan
from jaxsim.viz.plots.trajectories import (
    plot_contact_forces,
    plot_energy,
    plot_gradient,
    plot_trajectory,
)
from jaxsim.viz.recording import load_trajectory, save_trajectory

__all__ = [
    "Frames",
    "Page",
    "Picture",
    "film",
    "film_plan",
    "html",
    "load_trajectory",
    "plot_contact_forces",
    "plot_energy",
    "plot_fit",
    "plot_gradient",
    "plot_learning",
    "plot_plan",
    "plot_trajectory",
    "save_trajectory",
]
