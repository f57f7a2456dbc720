"""One environment: forward, step, rollout, inverse, and the host-side check of their results."""

from jaxsim.engine.check import SimulationError, check
from jaxsim.engine.report import ContactReport, Forward, forward, inverse
from jaxsim.engine.status import Status
from jaxsim.engine.step import rollout, step, step_with_status

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
    "step_with_status",
]
