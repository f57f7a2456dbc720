"""`Problem`: the costs of all constraint rows, and `Kind`, the interface of costs.

The solver minimises over x

    1/2 x^T M x - force^T x + sum over blocks of s(J x - aref)

(Todorov 2014, "Convex and analytically-invertible dynamics with contacts and constraints").
M and J are an `operator.Operator`; the cost s of every block of rows is a `Kind`.
"""

from typing import Protocol

from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.solver.operator import Rows


class Kind(Protocol):
    """A convex, continuously differentiable cost of a block of constraint rows.

    Residuals r and directions v have the shape of `aref`. Inactive rows have `D = 0`.
    """

    @property
    def aref(self) -> Array:
        """Reference acceleration of every row."""
        ...

    def cost(self, r: Array) -> Float[Array, ""]:
        """Total cost at the residual r."""
        ...

    def force(self, r: Array) -> Array:
        """`-ds/dr`."""
        ...

    def curvature(self, r: Array) -> Array:
        """Second derivative: the shape of r if diagonal, else (n, d, d) for r of shape (n, d)."""
        ...

    def slopes(self, r: Array, v: Array) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and second derivative of `t -> cost(r + t v)` at t = 0."""
        ...

    def change(self, r: Array, step: Array) -> Float[Array, ""]:
        """`cost(r + step) - cost(r)`, computed without cancellation."""
        ...

    def is_quadratic(self, r: Array, end: Array) -> Bool[Array, ""]:
        """Whether the cost is one quadratic from r to end: no row changes zone."""
        ...


@struct.dataclass
class Problem:
    """The blocks of constraint rows, in the order of the operator's rows.

    Attributes:
        blocks: The cost of each block; empty without constraints.
    """

    blocks: tuple[Kind, ...]

    def residuals(self, rows: Rows) -> Rows:
        """`r = J x - aref` of every block, given `J x`."""
        return tuple(jx - block.aref for block, jx in zip(self.blocks, rows, strict=True))

    def forces(self, rows: Rows) -> Rows:
        """Constraint forces `-ds/dr` of every block, given `J x`."""
        pairs = zip(self.blocks, self.residuals(rows), strict=True)
        return tuple(block.force(r) for block, r in pairs)

    def curvatures(self, rows: Rows) -> Rows:
        """Second derivatives of the cost of every block, given `J x`."""
        pairs = zip(self.blocks, self.residuals(rows), strict=True)
        return tuple(block.curvature(r) for block, r in pairs)

    def cost(self, rows: Rows) -> Float[Array, ""] | float:
        """Total constraint cost, given `J x`."""
        pairs = zip(self.blocks, self.residuals(rows), strict=True)
        return sum((block.cost(r) for block, r in pairs), start=0.0)
