"""An operator without bodies: dense matrices, a Cholesky factor of the Hessian for every step."""

from flax import struct
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Float

from jaxsim.solver import LinearStatus, weighed
from jaxsim.solver.operator import Rows


@struct.dataclass
class DensePoint:
    """A point x with its products.

    Attributes:
        x: The point.
        mx: `M x`.
        jx: `J x`, block by block.
    """

    x: Float[Array, "nv"]
    mx: Float[Array, "nv"]
    jx: Rows


@struct.dataclass
class DenseOperator:
    """Mass matrix and Jacobian as arrays; see `operator.Operator` for the methods.

    Attributes:
        mass: Symmetric positive definite M.
        jacobian: One J per block, of the shape of the block's `aref` and a last axis nv.
    """

    mass: Float[Array, "nv nv"]
    jacobian: Rows

    def lift(self, x: Float[Array, "nv"]) -> DensePoint:
        """The point with its products."""
        return DensePoint(x=x, mx=self.mass @ x, jx=tuple(J @ x for J in self.jacobian))

    def vector(self, y: DensePoint) -> Float[Array, "nv"]:
        """The point itself."""
        return y.x

    def rows(self, y: DensePoint) -> Rows:
        """`J x`."""
        return y.jx

    def inner(self, y1: DensePoint, y2: DensePoint) -> Float[Array, ""]:
        """`x1^T M x2`."""
        return y1.x @ y2.mx

    def residual(self, y: DensePoint, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f - M x`."""
        r = -y.mx
        for J, f in zip(self.jacobian, forces, strict=True):
            r = r + _flat(J).T @ f.reshape(-1)
        return r

    def hessian(self, curvatures: Rows) -> Float[Array, "nv nv"]:
        """`M + J^T W J`."""
        H = self.mass
        for J, W in zip(self.jacobian, curvatures, strict=True):
            H = H + _flat(J).T @ _flat(weighed(W, J))
        return H

    def unconstrained(self, r: Float[Array, "nv"]) -> DensePoint:
        """The lifted `M^-1 r`."""
        return self.lift(cho_solve(cho_factor(self.mass), r))

    def solve(self, curvatures: Rows, r: Float[Array, "nv"]) -> tuple[DensePoint, LinearStatus]:
        """The lifted `(M + J^T W J)^-1 r`."""
        x = cho_solve(cho_factor(self.hessian(curvatures), lower=True), r)
        return self.lift(x), LinearStatus()


def _flat(J: Float[Array, "*rows nv"]) -> Float[Array, "m nv"]:
    """All rows of a block along one axis."""
    size = 1
    for n in J.shape[:-1]:
        size *= n
    return J.reshape(size, J.shape[-1])
