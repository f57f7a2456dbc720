"""Pictures of simulations, by MuJoCo's renderer."""

from jaxsim.viz.frames import Frames
from jaxsim.viz.scene import scene

__all__ = ["Frames", "scene"]
