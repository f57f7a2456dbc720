"""Block-pentadiagonal normal equations: what couples a step with the two before it.

    H = [ A1 B2' C3'          ]
        [ B2 A2  B3' C4'      ]
        [ C3 B3  A3  B4' C5'  ]
        [    C4  B4  ...      ]

A Cholesky factor has the same bands, so a scan forwards factorises and a scan backwards solves, in
O(T m^3) for T blocks of size m. That is the way on a CPU. Elsewhere steps are eliminated in
parallel (`jaxsim.trajopt.transcription.parallel`), which is more work, but in log T steps.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.batching.matrices import cholesky, triangular_solve
from jaxsim.trajopt.transcription.parallel import solve_in_parallel


class Pentadiagonal(NamedTuple):
    """A symmetric positive definite matrix of T by T blocks; blocks that would lie outside are 0.

    Attributes:
      diagonal: A, the blocks of a step by itself.
      first: B, of a step by the one before it.
      second: C, of a step by the one two before it.
    """

    diagonal: Float[Array, "T m m"]
    first: Float[Array, "T m m"]
    second: Float[Array, "T m m"]

    def solve(self, b: Float[Array, "T m"]) -> Float[Array, "T m"]:
        """`H^-1 b`; NaN if H is not positive definite."""
        return lax.platform_dependent(
            *self,
            b,
            cpu=lambda *at: Pentadiagonal(*at[:3]).serial(at[3]),
            default=solve_in_parallel,
        )

    def serial(self, b: Float[Array, "T m"]) -> Float[Array, "T m"]:
        """The same by scans."""
        m = b.shape[1]
        eye, zero = jnp.eye(m, dtype=b.dtype), jnp.zeros((m, m), b.dtype)
        none = jnp.zeros(m, b.dtype)

        def forwards(carry, row):
            # Factors of the last two rows (1 and 2 before), and what they solved.
            (L1, M1, y1), (L2, y2) = carry
            A, B, C, b = row
            N = _right_divide(C, L2)
            M = _right_divide(B - N @ M1.T, L1)
            L = cholesky(A - M @ M.T - N @ N.T)
            y = triangular_solve(L, b - M @ y1 - N @ y2, lower=True)
            return ((L, M, y), (L1, y1)), (L, M, N, y)

        def backwards(carry, row):
            (M1, x1), (N1, N2, x2) = carry
            L, M, N, y = row
            x = triangular_solve(L.T, y - M1.T @ x1 - N2.T @ x2, lower=False)
            return ((M, x), (N, N1, x1)), x

        start = (eye, zero, none), (eye, none)
        _, rows = lax.scan(forwards, start, (*self, b))
        end = (zero, none), (zero, zero, none)
        return lax.scan(backwards, end, rows, reverse=True)[1]


def assemble(blocks: Float[Array, "T+1 3 m 3 m"]) -> Pentadiagonal:
    """The sum of T + 1 quadratics, the t-th of which is about the steps t - 1, t and t + 1.

    Unknown are the steps 1 to T; parts of other steps are left out.
    """
    diagonal = blocks[:-1, 2, :, 2] + blocks[1:, 1, :, 1] + later(blocks[1:, 0, :, 0])
    first = blocks[:-1, 2, :, 1] + blocks[1:, 1, :, 0]
    return Pentadiagonal(diagonal, first.at[0].set(0), blocks[:-1, 2, :, 0].at[:2].set(0))


def assemble_vector(blocks: Float[Array, "T+1 3 m"]) -> Float[Array, "T m"]:
    """As `assemble`, for gradients."""
    return blocks[:-1, 2] + blocks[1:, 1] + later(blocks[1:, 0])


def later(x: Float[Array, "T *m"]) -> Float[Array, "T *m"]:
    """Each entry one step earlier; zero at the end."""
    return jnp.concatenate([x[1:], jnp.zeros_like(x[:1])])


def _right_divide(X: Float[Array, "m m"], L: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """`X L^-T` for a lower triangular L."""
    return triangular_solve(L, X.T, lower=True).T
