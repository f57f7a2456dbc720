"""From primitives of JAX to scalar operations; importing this registers all rules."""

from jaxsim.lanes.rules import (
    control,
    elementwise,
    factors,
    indexing,
    reductions,
    shapes,
)

__all__ = ["control", "elementwise", "factors", "indexing", "reductions", "shapes"]
