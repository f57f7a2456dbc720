"""Maximal coordinates: every body moves freely, and joints are constraint rows."""

from jaxsim.maximal.building import to_maximal
from jaxsim.maximal.maximal import Maximal, MaximalState

__all__ = ["Maximal", "MaximalState", "to_maximal"]
