"""Gradients of discontinuous and long computations: options, estimators, windows, reports."""

from jaxsim.gradients.bundles import Estimate, first_order, mixed, zeroth_order
from jaxsim.gradients.horizon import (
    clip_cotangent,
    gradient_norms,
    stop_cotangent,
    truncate,
    usable_horizon,
)
from jaxsim.model.backward import Backward

__all__ = [
    "Backward",
    "Estimate",
    "clip_cotangent",
    "first_order",
    "gradient_norms",
    "mixed",
    "stop_cotangent",
    "truncate",
    "usable_horizon",
    "zeroth_order",
]
