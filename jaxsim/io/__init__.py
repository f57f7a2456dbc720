"""Loading models from files, strings and MuJoCo's objects, and exporting them to MuJoCo."""

from jaxsim.io.building import build
from jaxsim.io.constants import set_const
from jaxsim.io.export import to_mujoco
from jaxsim.io.loading import bundled_models, bundled_xml, load

__all__ = ["build", "bundled_models", "bundled_xml", "load", "set_const", "to_mujoco"]
