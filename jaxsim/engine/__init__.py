"""Simulation of one environment: forward, step, rollout, inverse, and `check` on the host."""

from jaxsim.engine.checking import SimulationError, check
from jaxsim.engine.details import ForwardDetails, forward_details
from jaxsim.engine.report import ContactReport, Forward, forward, inverse
from jaxsim.engine.status import Status
from jaxsim.engine.stepping import rollout, step, step_with_status
from jaxsim.engine.substepping import substeps

__all__ = [
    "ContactReport",
    "Forward",
    "ForwardDetails",
    "SimulationError",
    "Status",
    "check",
    "forward",
    "forward_details",
    "inverse",
    "rollout",
    "step",
    "step_with_status",
    "substeps",
]
