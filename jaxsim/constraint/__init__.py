"""Constraints: equality, dry friction, limit and contact rows, and the convex problem they form."""

from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.solve import (
    Constrained,
    constrained_acceleration,
    constrained_at,
    constraint_blocks,
    with_entry_times,
)

__all__ = [
    "Block",
    "Constrained",
    "RowType",
    "constrained_acceleration",
    "constrained_at",
    "constraint_blocks",
    "with_entry_times",
]
