"""One environment: forward, step, rollout, inverse, and the host-side check of their results."""

from jaxsim.engine.check import SimulationError, check
from jaxsim.engine.step import ContactReport, Forward, Status, forward, inverse, rollout, step

__all__ = [
    "ContactReport",
    "Forward",
    "SimulationError",
    "Status",
    "check",
    "forward",
    "inverse",
    "rollout",
    "step",
]
