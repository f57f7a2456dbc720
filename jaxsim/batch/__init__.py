"""Batches: `vmap` with the batch on the last axis, and rollouts over all devices."""

from jaxsim.batch.cpu import configure_cpu
from jaxsim.batch.rollout import batch_rollout
from jaxsim.batch.vmap import vmap

__all__ = ["batch_rollout", "configure_cpu", "vmap"]
