"""Sensors: MuJoCo's `sensordata` from positions, velocities, accelerations and forces."""

from jaxsim.sensor.sensordata import SUPPORTED, needs, sensordata
from jaxsim.sensor.signals import Signals

__all__ = ["SUPPORTED", "Signals", "needs", "sensordata"]
