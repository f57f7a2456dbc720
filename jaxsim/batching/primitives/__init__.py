"""Rules for JAX's primitives and our own; each is registered in the file with its rule."""

from jaxsim.batching.primitives import (
    calls,
    control_flow,
    decisions,
    derivatives,
    elementwise,
    factors,
    indexing,
    jvp_rule,
    lapack,
    one_at_a_time,
    own_kernel,
    products,
    reductions,
    shapes,
    trigonometry,
    while_loop,
)

__all__ = [
    "calls",
    "control_flow",
    "decisions",
    "derivatives",
    "elementwise",
    "factors",
    "indexing",
    "jvp_rule",
    "lapack",
    "one_at_a_time",
    "own_kernel",
    "products",
    "reductions",
    "shapes",
    "trigonometry",
    "while_loop",
]
