"""Many environments at once: all devices, chunks that stay in cache, the batch last."""

from jaxsim.parallel.cpu import configure_cpu
from jaxsim.parallel.rollout import batch_rollout

__all__ = ["batch_rollout", "configure_cpu"]
