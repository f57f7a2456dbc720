"""Sensors: MuJoCo's `sensordata` from positions, velocities, accelerations and forces."""

from jaxsim.sensor.signals import Signals
from jaxsim.sensor.table import SENSORS, needs, sensordata

__all__ = ["SENSORS", "Signals", "needs", "sensordata"]
