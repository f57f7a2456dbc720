"""A compiler: a traced program as one kernel, with a lane in each place of a vector or thread."""

from jaxsim.lanes.primitive import as_kernel
from jaxsim.lanes.pullback import with_pullback_kernel

__all__ = ["as_kernel", "with_pullback_kernel"]
