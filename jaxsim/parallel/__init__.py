"""Simulation of many environments: on all devices, in chunks that fit in the cache."""

from jaxsim.parallel.cpu import configure_cpu
from jaxsim.parallel.rollout import batch_rollout

__all__ = ["batch_rollout", "configure_cpu"]
