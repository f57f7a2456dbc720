"""A compiler for CPUs: a traced program as one kernel, the lanes of a batch in its vectors."""

from jaxsim.lanes.primitive import as_kernel

__all__ = ["as_kernel"]
