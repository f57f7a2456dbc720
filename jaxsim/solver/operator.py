"""What the solver asks of the mass matrix M and the constraint Jacobian J.

An operator hides how `M x`, `J x` and `(M + J^T W J)^-1 r` are found: with matrices, with conjugate
gradients (`pcg.pcg_solve`), or by walks over a tree of bodies.
The solver handles points only in *lifted* form, a pytree y that is linear in x and carries
whatever the operator wants to know about x, say `(x, M x, J x)`. Adding lifted points adds the
points, so a step along a line never multiplies by M or J again.

An operator is itself a pytree, its numbers are leaves: `implicit.attach` differentiates with
respect to them.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Array, Bool, Float, Int

Rows = tuple[Array, ...]
"""One array per block of constraint rows."""

Lifted = Any
"""A pytree of arrays, linear in the point x that it stands for."""


class LinearStatus(NamedTuple):
    """How linear solves went. The defaults are those of a direct solve.

    Attributes:
        iterations: Iterations of conjugate gradients.
        converged: False if they ran out, or met what is not positive definite or not finite.
    """

    iterations: Int[Array, ""] | np.int32 = np.int32(0)
    converged: Bool[Array, ""] | np.bool_ = np.bool_(True)

    def then(self, later: "LinearStatus") -> "LinearStatus":
        """The status of these solves and later ones together."""
        return LinearStatus(self.iterations + later.iterations, self.converged & later.converged)


@runtime_checkable
class Operator(Protocol):
    """Products with, and solves of, the matrices of the constrained problem."""

    def lift(self, x: Float[Array, "nv"]) -> Lifted:
        """The lifted form of x."""
        ...

    def vector(self, y: Lifted) -> Float[Array, "nv"]:
        """The point x that y stands for."""
        ...

    def rows(self, y: Lifted) -> Rows:
        """`J x`, block by block, each in the shape of its block's `aref`."""
        ...

    def inner(self, y1: Lifted, y2: Lifted) -> Float[Array, ""]:
        """`x1^T M x2`."""
        ...

    def residual(self, y: Lifted, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f - M x`; with the other forces added, minus the gradient of the objective."""
        ...

    def unconstrained(self, r: Float[Array, "nv"]) -> Lifted:
        """The lifted `M^-1 r`."""
        ...

    def solve(self, curvatures: Rows, r: Float[Array, "nv"]) -> tuple[Lifted, LinearStatus]:
        """The lifted solution of `(M + J^T W J) s = r`, and how it was found.

        W is diagonal in blocks whose curvature has the shape of `aref`, block diagonal in those
        of shape (n, d, d). The result must be linear in r; nobody differentiates it.
        """
        ...


def weighed(W: Array, J: Float[Array, "*rows k"]) -> Float[Array, "*rows k"]:
    """`W J` of one block of rows, W diagonal or in blocks as in `Operator.solve`."""
    return W[..., None] * J if W.ndim < J.ndim else W @ J
