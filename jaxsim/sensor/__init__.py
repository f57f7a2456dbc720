"""Sensors: MuJoCo's `sensordata` from positions, velocities, accelerations and forces."""

from jaxsim.sensor.sensordata import SENSORS, needs, sensordata
from jaxsim.sensor.signals import Signals

__all__ = ["SENSORS", "Signals", "needs", "sensordata"]
