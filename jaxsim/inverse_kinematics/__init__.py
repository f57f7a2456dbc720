"""Inverse kinematics: coordinates at which sites and bodies are where they should be."""

from jaxsim.inverse_kinematics.solving import IkResult, ik
from jaxsim.inverse_kinematics.target import PoseTarget

__all__ = ["IkResult", "PoseTarget", "ik"]
