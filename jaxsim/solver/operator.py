"""`Operator`: the interface of the mass matrix M and the constraint Jacobian J.

An operator computes `M x`, `J x` and `(M + J^T W J)^-1 r` by matrices, by conjugate gradients
(`conjugate_gradients.pcg_solve`), or by recursions over a tree of bodies.

The solver uses points only in *lifted* form: a pytree y that is linear in x and contains linear
functions of x that the operator needs again, such as `(x, M x, J x)`. Lifted points are added like
points, so a step along a line needs no further products with M or J.

An operator is a pytree whose leaves are its numbers, so that `implicit.attach` can differentiate
with respect to them.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Array, Bool, Float, Int

Rows = tuple[Array, ...]
"""One array per block of constraint rows."""

Lifted = Any
"""A pytree of arrays that is linear in the point x."""


class LinearStatus(NamedTuple):
    """Status of linear solves; the defaults are those of a direct solve.

    Attributes:
        iterations: Iterations of conjugate gradients.
        converged: False if the iterations ran out, or if the matrix was not positive definite or
            not finite.
    """

    iterations: Int[Array, ""] | np.int32 = np.int32(0)
    converged: Bool[Array, ""] | np.bool_ = np.bool_(True)

    def then(self, later: "LinearStatus") -> "LinearStatus":
        """The combined status of these solves and of later ones."""
        return LinearStatus(self.iterations + later.iterations, self.converged & later.converged)


@runtime_checkable
class Operator(Protocol):
    """Products with, and solves of, the matrices of the constrained problem."""

    def lift(self, x: Float[Array, "nv"]) -> Lifted:
        """The lifted form of x."""
        ...

    def vector(self, y: Lifted) -> Float[Array, "nv"]:
        """The point x of a lifted point y."""
        ...

    def rows(self, y: Lifted) -> Rows:
        """`J x` of each block, in the shape of the block's `aref`."""
        ...

    def inner(self, y1: Lifted, y2: Lifted) -> Float[Array, ""]:
        """`x1^T M x2`."""
        ...

    def residual(self, y: Lifted, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f - M x`; plus the other forces, it is minus the gradient of the objective."""
        ...

    def unconstrained(self, r: Float[Array, "nv"]) -> Lifted:
        """The lifted `M^-1 r`."""
        ...

    def solve(
        self,
        curvatures: Rows,
        r: Float[Array, "nv"],
        enough: Float[Array, ""] | float = 0.0,
        spare: Float[Array, ""] | float = 0.0,
    ) -> tuple[Lifted, LinearStatus]:
        """The lifted solution of `(M + J^T W J) s = r`, and the status of the solve.

        An iterative solve may end where its relative residual is `enough`, or where what is left
        of the residual could lower the objective by about `spare`; zeros mean accurately.

        W is diagonal for blocks whose curvature has the shape of `aref`, and block diagonal for
        blocks of shape (n, d, d). The result must be linear in r; it is not differentiated.
        """
        ...


def weighed(W: Array, J: Float[Array, "*rows k"]) -> Float[Array, "*rows k"]:
    """`W J` of one block of rows; W is diagonal or block diagonal, as in `Operator.solve`."""
    return W[..., None] * J if W.ndim < J.ndim else W @ J
